/* A function that can be called by name: its arrays, with the length and kind of each. */
#ifndef HDA_ENTRY_H
#define HDA_ENTRY_H

typedef struct {
    const char *name;
    char kind; /* d float64, i int32, B bytes */
    long count;
    int writable;
} hda_argument;

typedef struct {
    const char *name;
    int count;
    void (*call)(void *const *);
    hda_argument arguments[16];
} hda_entry;

#endif
