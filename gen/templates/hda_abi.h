/* The dozen declarations of Python's stable ABI that are used, so that building needs no Python headers; their layout
 * is fixed by PEP 384 and the list of the stable ABI (Py_buffer since 3.11). */
#ifndef HDA_ABI_H
#define HDA_ABI_H

#include <stddef.h>

typedef ptrdiff_t Py_ssize_t;
typedef struct object {
    Py_ssize_t references;
    void *type;
} PyObject;
typedef struct {
    void *buf;
    PyObject *obj;
    Py_ssize_t len, itemsize;
    int readonly, ndim;
    char *format;
    Py_ssize_t *shape, *strides, *suboffsets;
    void *internal;
} Py_buffer;
typedef struct {
    const char *name;
    void (*method)(void);
    int flags;
    const char *doc;
} PyMethodDef;
typedef struct {
    int slot;
    void *value;
} Slot;
typedef struct {
    const char *name;
    int basicsize, itemsize;
    unsigned int flags;
    Slot *slots;
} PyType_Spec;
typedef struct {
    PyObject head;
    PyObject *(*init)(void);
    Py_ssize_t index;
    PyObject *copy;
    const char *name, *doc;
    Py_ssize_t size;
    PyMethodDef *methods;
    Slot *slots;
    void *traverse, *clear, *free;
} PyModuleDef;

enum {
    WRITABLE = 1,
    FORMAT = 4,
    C_CONTIGUOUS = 0x38,
    NOARGS = 4,
    FASTCALL = 0x80,
    TP_DEALLOC = 52,
    TP_DOC = 56,
    TP_METHODS = 64,
    MOD_EXEC = 2
};

extern PyObject _Py_NoneStruct;
extern PyObject *PyExc_ValueError, *PyExc_TypeError, *PyExc_MemoryError;
extern int PyObject_GetBuffer(PyObject *, Py_buffer *, int);
extern void PyBuffer_Release(Py_buffer *);
extern void PyErr_SetString(PyObject *, const char *);
extern PyObject *PyErr_Format(PyObject *, const char *, ...);
extern PyObject *PyErr_Occurred(void);
extern void PyErr_Clear(void);
extern void Py_IncRef(PyObject *);
extern void Py_DecRef(PyObject *);
extern const char *PyUnicode_AsUTF8AndSize(PyObject *, Py_ssize_t *);
extern long PyLong_AsLong(PyObject *);
extern PyObject *PyLong_FromLong(long);
extern double PyFloat_AsDouble(PyObject *);
extern PyObject *PyUnicode_FromString(const char *);
extern PyObject *PyType_FromSpec(PyType_Spec *);
extern PyObject *PyType_GenericAlloc(PyObject *, Py_ssize_t);
extern void PyObject_Free(void *);
extern PyObject *PyModuleDef_Init(PyModuleDef *);
extern int PyModule_AddObjectRef(PyObject *, const char *, PyObject *);
extern void *PyModule_GetState(PyObject *);
extern void *PyEval_SaveThread(void);
extern void PyEval_RestoreThread(void *);

#endif
