/* The compiled model as a Python module, over the stable ABI.
 *
 * bind() checks every buffer once; run() only calls.
 */
#include "hda.h"
#include "hda_python.h"

#include <string.h>

#include "hda_table.h"

PyObject *hda_none(void) {
    Py_IncRef(&_Py_NoneStruct);
    return &_Py_NoneStruct;
}

/* ---- buffers ---- */

static int fits(const hda_argument *a, PyObject *given, Py_ssize_t rows, Py_buffer *view, Py_ssize_t *stride) {
    if (PyObject_GetBuffer(given, view, C_CONTIGUOUS | FORMAT | (a->writable ? WRITABLE : 0)) < 0) {
        PyErr_Clear();
        PyErr_Format(PyExc_TypeError, "%s must be a %scontiguous array of %s", a->name, a->writable ? "writable " : "",
                     a->kind == 'd'   ? "float64"
                     : a->kind == 'i' ? "int32"
                                      : "uint8");
        return 0;
    }
    const Py_ssize_t size = a->kind == 'd' ? 8 : a->kind == 'i' ? 4 : 1;
    const char *format = view->format ? view->format : "B";
    const int right = a->kind == 'd'   ? !strcmp(format, "d") || !strcmp(format, "<d")
                      : a->kind == 'i' ? !strcmp(format, "i") || !strcmp(format, "<i")
                                       : size == view->itemsize;
    if (!right || view->itemsize != size) {
        PyErr_Format(PyExc_TypeError, "%s must hold %s, not items of format '%s'", a->name,
                     a->kind == 'd'   ? "float64"
                     : a->kind == 'i' ? "int32"
                                      : "uint8",
                     format);
    } else if (view->len == a->count * size) {
        *stride = 0;
        return 1;
    } else if (rows > 1 && view->len % (a->count * size) == 0 && view->len / (a->count * size) == rows) {
        *stride = a->count * size;
        return 1;
    } else {
        PyErr_Format(PyExc_ValueError, "%s must have %zd entries, not %zd", a->name, (Py_ssize_t)a->count,
                     view->len / size);
    }
    PyBuffer_Release(view);
    return 0;
}

static const hda_entry *find(PyObject *name) {
    const char *text = PyUnicode_AsUTF8AndSize(name, NULL);
    if (!text) return NULL;
    for (const hda_entry *e = hda_table; e->name; e++) {
        if (!strcmp(e->name, text)) return e;
    }
    PyErr_Format(PyExc_ValueError, "no function named '%s'; the manifest lists them", text);
    return NULL;
}

int hda_take(const hda_entry *e, PyObject *const *given, Py_ssize_t count, Py_ssize_t rows, Py_buffer *views, void **at,
             Py_ssize_t *stride) {
    if (count != e->count) {
        PyErr_Format(PyExc_TypeError, "%s takes %zd arrays, not %zd", e->name, (Py_ssize_t)e->count, count);
        return 0;
    }
    for (int k = 0; k < e->count; k++) {
        if (!fits(&e->arguments[k], given[k], rows, &views[k], &stride[k])) {
            while (k-- > 0) PyBuffer_Release(&views[k]);
            return 0;
        }
        at[k] = views[k].buf;
    }
    return 1;
}

/* ---- a function bound to its buffers ---- */

typedef struct {
    PyObject head;
    void (*call)(void *const *);
    int count;
    void *at[HDA_MOST_ARRAYS];
    Py_buffer views[HDA_MOST_ARRAYS];
} Bound;

static PyObject *run(PyObject *self, PyObject *ignored) {
    (void)ignored;
    ((Bound *)self)->call(((Bound *)self)->at);
    return hda_none();
}

static void dealloc(PyObject *self) {
    Bound *bound = (Bound *)self;
    PyObject *type = (PyObject *)self->type;
    for (int k = 0; k < bound->count; k++) PyBuffer_Release(&bound->views[k]);
    PyObject_Free(self);
    Py_DecRef(type);
}

static PyMethodDef bound_methods[] = {
    {"run", (void (*)(void))run, NOARGS, "run(): call the function on the bound arrays."},
    {NULL, NULL, 0, NULL},
};
static Slot bound_slots[] = {
    {TP_DEALLOC, (void *)(size_t)dealloc},
    {TP_METHODS, bound_methods},
    {TP_DOC, (void *)(size_t)"A function bound to its arrays; it keeps them alive."},
    {0, NULL},
};
static PyType_Spec bound_spec = {"hda.Bound", sizeof(Bound), 0, 1u << 7 /* no instances from Python */, bound_slots};

static PyObject *bind(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    Py_ssize_t stride[HDA_MOST_ARRAYS];
    const hda_entry *e = count > 0 ? find(args[0]) : NULL;
    if (!e) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_TypeError, "bind takes a function's name and its arrays");
        return NULL;
    }
    Bound *bound = (Bound *)PyType_GenericAlloc(*(PyObject **)PyModule_GetState(module), 0);
    if (!bound) return NULL;
    if (!hda_take(e, args + 1, count - 1, 1, bound->views, bound->at, stride)) {
        Py_DecRef(&bound->head);
        return NULL;
    }
    bound->call = e->call;
    bound->count = e->count;
    return &bound->head;
}

/* map(name, rows, arrays...): the function on every row; an array with one row's entries serves all rows. */
static PyObject *map(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    Py_ssize_t stride[HDA_MOST_ARRAYS];
    Py_buffer views[HDA_MOST_ARRAYS];
    void *at[HDA_MOST_ARRAYS];
    const hda_entry *e = count > 1 ? find(args[0]) : NULL;
    if (!e) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_TypeError, "map takes a function's name, a number of rows and its arrays");
        return NULL;
    }
    const long rows = PyLong_AsLong(args[1]);
    if (rows == -1 && PyErr_Occurred()) return NULL;
    if (!hda_take(e, args + 2, count - 2, rows, views, at, stride)) return NULL;
    void *thread = PyEval_SaveThread();
    for (long row = 0; row < rows; row++) {
        e->call(at);
        for (int k = 0; k < e->count; k++) at[k] = (char *)at[k] + stride[k];
    }
    PyEval_RestoreThread(thread);
    for (int k = 0; k < e->count; k++) PyBuffer_Release(&views[k]);
    return hda_none();
}

/* ---- the module ---- */

static PyObject *empty(PyObject *self, PyObject *ignored) {
    (void)self;
    (void)ignored;
    return hda_none();
}

static PyObject *sentence(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 1) {
        PyErr_SetString(PyExc_TypeError, "sentence takes a status");
        return NULL;
    }
    const long status = PyLong_AsLong(args[0]);
    if (status == -1 && PyErr_Occurred()) return NULL;
    return PyUnicode_FromString(hda_controller_sentence((int)status));
}

/* length(name, argument): entries of an array that bind() expects */
static PyObject *length(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 2) {
        PyErr_SetString(PyExc_TypeError, "length takes a function's name and an array's");
        return NULL;
    }
    const hda_entry *e = find(args[0]);
    const char *text = e ? PyUnicode_AsUTF8AndSize(args[1], NULL) : NULL;
    if (!text) return NULL;
    for (int k = 0; k < e->count; k++) {
        if (!strcmp(e->arguments[k].name, text)) return PyLong_FromLong(e->arguments[k].count);
    }
    PyErr_Format(PyExc_ValueError, "%s has no array named '%s'", e->name, text);
    return NULL;
}

static PyMethodDef methods[] = {
    {"bind", (void (*)(void))bind, FASTCALL, "bind(name, *arrays): a function bound to its arrays."},
    {"map", (void (*)(void))map, FASTCALL, "map(name, rows, *arrays): the function on every row."},
    {"rollout", (void (*)(void))hda_python_rollout, FASTCALL,
     "rollout(kind, x0, u, c, dt, most, count, x): simulate over time."},
    {"windows", (void (*)(void))hda_python_windows, FASTCALL,
     "windows(begun, memory, edges, u, c, dt, jump, limit, x, most, count): windows that begin anew."},
    {"late", (void (*)(void))hda_python_late, FASTCALL,
     "late(x, time, path, far, age, seen): what encoders show that are read late."},
    {"filters", (void (*)(void))hda_python_filters, FASTCALL,
     "filters(...): the state at the end of each span, by a bank of filters."},
    {"sentence", (void (*)(void))sentence, FASTCALL, "sentence(status): what a controller's status means."},
    {"length", (void (*)(void))length, FASTCALL, "length(name, array): entries that bind() expects."},
    {"empty", (void (*)(void))empty, NOARGS, "empty(): nothing, to time a call."},
    {NULL, NULL, 0, NULL},
};

static int execute(PyObject *module) {
    PyObject *type = PyType_FromSpec(&bound_spec);
    if (!type) return -1;
    *(PyObject **)PyModule_GetState(module) = type;
    PyObject *hash = PyUnicode_FromString(HDA_BUILD);
    if (!hash) return -1;
    PyObject *width = PyLong_FromLong(hda_batch_width());
    if (!width) return -1;
    PyObject *number = PyLong_FromLong(HDA_INTERFACE);
    if (!number) return -1;
    const int failed = PyModule_AddObjectRef(module, "build", hash) < 0 ||
                       PyModule_AddObjectRef(module, "batch_width", width) < 0 ||
                       PyModule_AddObjectRef(module, "interface", number) < 0;
    Py_DecRef(hash);
    Py_DecRef(width);
    Py_DecRef(number);
    return failed ? -1 : 0;
}

static Slot slots[] = {{MOD_EXEC, (void *)(size_t)execute}, {0, NULL}};
static PyModuleDef definition = {{1, NULL},          NULL,    0,     NULL, "hda", "A compiled robot arm.",
                                 sizeof(PyObject *), methods, slots, NULL, NULL,  NULL};

extern __attribute__((visibility("default"))) PyObject *PyInit_hda(void);
PyObject *PyInit_hda(void) {
    return PyModuleDef_Init(&definition);
}
