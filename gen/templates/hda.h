/* Everything that a build offers but its controllers: the guard, and the compiled arm. */
#ifndef HDA_H
#define HDA_H

#include "hda_guard.h"
#include "hda_model.h"

#endif
