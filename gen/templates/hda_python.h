/* What the files of the Python module share. */
#ifndef HDA_PYTHON_H
#define HDA_PYTHON_H

#include "hda_abi.h"
#include "hda_entry.h"

enum { HDA_MOST_ARRAYS = 24 }; /* of a function */

/* A new reference to None. */
PyObject *hda_none(void);

/* Takes all buffers of an entry, or none: whether it did, or an exception is set. An array with `rows` times its
 * entries has a stride from row to row. */
int hda_take(const hda_entry *e, PyObject *const *given, Py_ssize_t count, Py_ssize_t rows, Py_buffer *views, void **at,
             Py_ssize_t *stride);

PyObject *hda_python_rollout(PyObject *module, PyObject *const *args, Py_ssize_t count);
PyObject *hda_python_windows(PyObject *module, PyObject *const *args, Py_ssize_t count);
PyObject *hda_python_late(PyObject *module, PyObject *const *args, Py_ssize_t count);
PyObject *hda_python_filters(PyObject *module, PyObject *const *args, Py_ssize_t count);

#endif
