/* The compiled model as a Python module, over the stable ABI.
 *
 * bind() checks every buffer once; run() only calls.
 */
#include "hda.h"
#include "hda_abi.h"
#include "hda_filters.h"

#include <limits.h>
#include <string.h>

#include "hda_table.h"

enum { MOST = 24 }; /* arrays of a function */

static PyObject *none(void) {
    Py_IncRef(&_Py_NoneStruct);
    return &_Py_NoneStruct;
}

/* ---- buffers ---- */

static int fits(const hda_argument *a, PyObject *given, Py_ssize_t rows, Py_buffer *view, Py_ssize_t *stride) {
    if (PyObject_GetBuffer(given, view, C_CONTIGUOUS | FORMAT | (a->writable ? WRITABLE : 0)) < 0) {
        PyErr_Clear();
        PyErr_Format(PyExc_TypeError, "%s must be a %scontiguous array of %s", a->name, a->writable ? "writable " : "", a->kind == 'd' ? "float64" : a->kind == 'i' ? "int32" : "uint8");
        return 0;
    }
    const Py_ssize_t size = a->kind == 'd' ? 8 : a->kind == 'i' ? 4 : 1;
    const char *format = view->format ? view->format : "B";
    const int right = a->kind == 'd' ? !strcmp(format, "d") || !strcmp(format, "<d") : a->kind == 'i' ? !strcmp(format, "i") || !strcmp(format, "<i") : size == view->itemsize;
    if (!right || view->itemsize != size) {
        PyErr_Format(PyExc_TypeError, "%s must hold %s, not items of format '%s'", a->name, a->kind == 'd' ? "float64" : a->kind == 'i' ? "int32" : "uint8", format);
    } else if (view->len == a->count * size) {
        *stride = 0;
        return 1;
    } else if (rows > 1 && view->len % (a->count * size) == 0 && view->len / (a->count * size) == rows) {
        *stride = a->count * size;
        return 1;
    } else {
        PyErr_Format(PyExc_ValueError, "%s must have %zd entries, not %zd", a->name, (Py_ssize_t)a->count, view->len / size);
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

/* Takes all buffers of an entry, or none. */
static int take(const hda_entry *e, PyObject *const *given, Py_ssize_t count, Py_ssize_t rows, Py_buffer *views, void **at, Py_ssize_t *stride) {
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
    void *at[MOST];
    Py_buffer views[MOST];
} Bound;

static PyObject *run(PyObject *self, PyObject *ignored) {
    (void)ignored;
    ((Bound *)self)->call(((Bound *)self)->at);
    return none();
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
    Py_ssize_t stride[MOST];
    const hda_entry *e = count > 0 ? find(args[0]) : NULL;
    if (!e) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_TypeError, "bind takes a function's name and its arrays");
        return NULL;
    }
    Bound *bound = (Bound *)PyType_GenericAlloc(*(PyObject **)PyModule_GetState(module), 0);
    if (!bound) return NULL;
    if (!take(e, args + 1, count - 1, 1, bound->views, bound->at, stride)) {
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
    Py_ssize_t stride[MOST];
    Py_buffer views[MOST];
    void *at[MOST];
    const hda_entry *e = count > 1 ? find(args[0]) : NULL;
    if (!e) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_TypeError, "map takes a function's name, a number of rows and its arrays");
        return NULL;
    }
    const long rows = PyLong_AsLong(args[1]);
    if (rows == -1 && PyErr_Occurred()) return NULL;
    if (!take(e, args + 2, count - 2, rows, views, at, stride)) return NULL;
    void *thread = PyEval_SaveThread();
    for (long row = 0; row < rows; row++) {
        e->call(at);
        for (int k = 0; k < e->count; k++) at[k] = (char *)at[k] + stride[k];
    }
    PyEval_RestoreThread(thread);
    for (int k = 0; k < e->count; k++) PyBuffer_Release(&views[k]);
    return none();
}

/* ---- rollouts ---- */

/* rollout(kind, x0, u, c, dt, most, count, x): kind 0 smooth, 1 set-valued, 2 batch with shared c, 3 batch with its own c each */
static PyObject *rollout(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 8) {
        PyErr_SetString(PyExc_TypeError, "rollout takes (kind, x0, u, c, dt, most, count, x)");
        return NULL;
    }
    const long kind = PyLong_AsLong(args[0]), many = PyLong_AsLong(args[6]);
    const double most = PyFloat_AsDouble(args[5]);
    if (PyErr_Occurred()) return NULL;
    if (kind < 0 || kind > 3 || many < 1 || (kind < 2 && many != 1) || !(most > 0.0)) {
        PyErr_SetString(PyExc_ValueError, "rollout: kind is 0 to 3, count at least 1 (1 unless a batch), the longest step above 0");
        return NULL;
    }
    Py_buffer dt;
    if (PyObject_GetBuffer(args[4], &dt, C_CONTIGUOUS | FORMAT) < 0) return NULL;
    const long rows = (long)(dt.len / 8);
    if (many > LONG_MAX / 8 / (rows + 1) / (HDA_NX + HDA_NU + HDA_NC)) { /* the lengths below would overflow */
        PyBuffer_Release(&dt);
        PyErr_SetString(PyExc_ValueError, "rollout: count is larger than any array can be");
        return NULL;
    }
    hda_entry e = {"rollout", 5, NULL, {
        {"dt", 'd', rows, 0},
        {"x0", 'd', many * HDA_NX, 0},
        {"u", 'd', many * rows * HDA_NU, 0},
        {"c", 'd', (kind == 3 ? many : 1) * HDA_NC, 0},
        {"x", 'd', many * (rows + 1) * HDA_NX, 1},
    }};
    PyObject *given[5] = {args[4], args[1], args[2], args[3], args[7]};
    Py_buffer views[MOST];
    void *at[MOST];
    Py_ssize_t stride[MOST];
    const int taken = take(&e, given, 5, 1, views, at, stride);
    PyBuffer_Release(&dt);
    if (!taken) return NULL;
    void *thread = PyEval_SaveThread();
    if (kind == 0) {
        hda_rollout(at[1], at[2], at[3], at[0], rows, most, at[4]);
    } else if (kind == 1) {
        hda_rollout_exact(at[1], at[2], at[3], at[0], rows, most, at[4]);
    } else {
        hda_rollout_batch(at[1], at[2], at[3], at[0], rows, most, many, kind == 3, at[4]);
    }
    PyEval_RestoreThread(thread);
    for (int k = 0; k < 5; k++) PyBuffer_Release(&views[k]);
    return none();
}

/* windows(begun, edges, u, c, dt, jump, limit, x, most, count): windows that each begin anew, set-valued friction, in `count` lanes
 * with their own begun, u, c, jump and x; jump may be None */
static PyObject *windows(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 10) {
        PyErr_SetString(PyExc_TypeError, "windows takes (begun, edges, u, c, dt, jump, limit, x, most, count)");
        return NULL;
    }
    const double most = PyFloat_AsDouble(args[8]);
    const long lanes = PyLong_AsLong(args[9]);
    if (PyErr_Occurred()) return NULL;
    if (!(most > 0.0) || lanes < 1) {
        PyErr_SetString(PyExc_ValueError, "windows: the longest step must be above 0, count at least 1");
        return NULL;
    }
    Py_buffer sized[2];
    if (PyObject_GetBuffer(args[1], &sized[0], C_CONTIGUOUS | FORMAT) < 0) return NULL;
    if (PyObject_GetBuffer(args[4], &sized[1], C_CONTIGUOUS | FORMAT) < 0) {
        PyBuffer_Release(&sized[0]);
        return NULL;
    }
    const long many = (long)(sized[0].len / 8), rows = (long)(sized[1].len / 8);
    const int *edge = sized[0].buf;
    long within = 0;
    int right = many > 0 && sized[0].len % 8 == 0;
    for (long w = 0; right && w < many; w++) {
        right = edge[2 * w] >= (w ? edge[2 * w - 1] : 0) && edge[2 * w + 1] > edge[2 * w] && edge[2 * w + 1] <= rows;
        within += edge[2 * w + 1] - edge[2 * w];
    }
    PyBuffer_Release(&sized[0]);
    PyBuffer_Release(&sized[1]);
    if (!right || lanes > LONG_MAX / 8 / (rows + 1) / (HDA_NX + HDA_NU + HDA_NC)) { /* the lengths below would overflow */
        PyErr_SetString(PyExc_ValueError, right ? "windows: count is larger than any array can be" : "windows: edges must be rows [first, end) in rising order within those of dt");
        return NULL;
    }
    const int jumps = args[5] != &_Py_NoneStruct;
    hda_entry e = {"windows", 7 + jumps, NULL, {
        {"begun", 'd', lanes * many * HDA_MECHANICAL, 0},
        {"edges", 'i', many * 2, 0},
        {"u", 'd', lanes * rows * HDA_NU, 0},
        {"c", 'd', lanes * HDA_NC, 0},
        {"dt", 'd', rows, 0},
        {"limit", 'd', HDA_NX, 0},
        {"x", 'd', lanes * within * HDA_NX, 1},
        {"jump", 'd', lanes * rows * HDA_NX, 0},
    }};
    PyObject *given[8] = {args[0], args[1], args[2], args[3], args[4], args[6], args[7], args[5]};
    Py_buffer views[MOST];
    void *at[MOST];
    Py_ssize_t stride[MOST];
    if (!take(&e, given, 7 + jumps, 1, views, at, stride)) return NULL;
    void *thread = PyEval_SaveThread();
    hda_rollout_windows_batch(at[0], at[1], many, at[2], at[3], at[4], rows, most, jumps ? at[7] : NULL, at[5], lanes, at[6]);
    PyEval_RestoreThread(thread);
    for (int k = 0; k < 7 + jumps; k++) PyBuffer_Release(&views[k]);
    return none();
}

/* filters(begun, extra, covariance, spans, u, time, c, measured, variance, read, places, spread, settings, found): the bank over each
 * of the spans (first row, last row); places: what the channels show, then the flexible joints; settings: those of hda_bank */
static PyObject *filters(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 14) {
        PyErr_SetString(PyExc_TypeError, "filters takes (begun, extra, covariance, spans, u, time, c, measured, variance, read, places, spread, settings, found)");
        return NULL;
    }
    long sizes[4]; /* spans, rows, places, spread: in bytes */
    const int sized[4] = {3, 5, 10, 11};
    for (int k = 0; k < 4; k++) {
        Py_buffer view;
        if (PyObject_GetBuffer(args[sized[k]], &view, C_CONTIGUOUS | FORMAT) < 0) return NULL;
        sizes[k] = (long)view.len;
        PyBuffer_Release(&view);
    }
    const long many = sizes[0] / 8, rows = sizes[1] / 8, M = sizes[2] / 4 - HDA_FLEXIBLE, E = sizes[3] / 8 / HDA_FILTERS, D = HDA_MECHANICAL + E;
    if (many < 1 || rows < 2 || M < 1 || M > HDA_CHANNELS_MOST || E < HDA_EXTRA_LEAST || E > HDA_EXTRA_MOST) {
        PyErr_SetString(PyExc_ValueError, "filters: a span, two rows and a channel at least, and the extra torques of this arm");
        return NULL;
    }
    hda_entry e = {"filters", 14, NULL, {
        {"begun", 'd', many * HDA_FILTERS * HDA_NX, 0},
        {"extra", 'd', many * HDA_FILTERS * E, 0},
        {"covariance", 'd', many * HDA_FILTERS * D * D, 0},
        {"spans", 'i', many * 2, 0},
        {"u", 'd', rows * HDA_NU, 0},
        {"time", 'd', rows, 0},
        {"c", 'd', HDA_NC, 0},
        {"measured", 'd', rows * M, 0},
        {"variance", 'd', many * M, 0},
        {"read", 'd', M * D, 0},
        {"places", 'i', M + HDA_FLEXIBLE, 0},
        {"spread", 'd', HDA_FILTERS * E, 0},
        {"settings", 'd', HDA_BANK_REAL, 0},
        {"found", 'd', many * HDA_NX, 1},
    }};
    Py_buffer views[MOST];
    void *at[MOST];
    Py_ssize_t stride[MOST];
    if (!take(&e, args, 14, 1, views, at, stride)) return NULL;
    const int *spans = at[3], *places = at[10];
    const double *settings = at[12], *of = settings + 3;
    const hda_bank bank = {(int)M, (int)E, places, places + M, at[9], at[11], settings, of, of + HDA_NX, of + HDA_NX + HDA_MECHANICAL,
                           of + HDA_NX + HDA_MECHANICAL + HDA_N, of + HDA_NX + HDA_MECHANICAL + 2 * HDA_N};
    int right = settings[2] > 0.0;
    for (long k = 0; k < many; k++) right &= spans[2 * k] >= 0 && spans[2 * k + 1] > spans[2 * k] && spans[2 * k + 1] < rows;
    for (long k = 0; k < M; k++) right &= places[k] >= 0 && places[k] < HDA_CHANNELS_MOST;
    for (int k = 0; k < HDA_FLEXIBLE; k++) right &= places[M + k] >= 0 && places[M + k] < HDA_N;
    void *thread = PyEval_SaveThread();
    for (long k = 0; right && k < many; k++) {
        hda_filter(&bank, (double *)at[0] + k * HDA_FILTERS * HDA_NX, (double *)at[1] + k * HDA_FILTERS * E, (double *)at[2] + k * HDA_FILTERS * D * D,
                   spans[2 * k], spans[2 * k + 1], at[4], at[5], at[6], at[7], (double *)at[8] + k * M, (double *)at[13] + k * HDA_NX);
    }
    PyEval_RestoreThread(thread);
    for (int k = 0; k < 14; k++) PyBuffer_Release(&views[k]);
    if (!right) {
        PyErr_SetString(PyExc_ValueError, "filters: spans must be rows first < last within those of time, places those of channels and joints, the longest step above 0");
        return NULL;
    }
    return none();
}

/* ---- the module ---- */

static PyObject *empty(PyObject *self, PyObject *ignored) {
    (void)self;
    (void)ignored;
    return none();
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
    {"rollout", (void (*)(void))rollout, FASTCALL, "rollout(kind, x0, u, c, dt, most, count, x): simulate over time."},
    {"windows", (void (*)(void))windows, FASTCALL, "windows(begun, edges, u, c, dt, jump, limit, x, most, count): windows that begin anew."},
    {"filters", (void (*)(void))filters, FASTCALL, "filters(...): the state at the end of each span, by a bank of filters."},
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
    const int failed = PyModule_AddObjectRef(module, "build", hash) < 0 || PyModule_AddObjectRef(module, "batch_width", width) < 0;
    Py_DecRef(hash);
    Py_DecRef(width);
    return failed ? -1 : 0;
}

static Slot slots[] = {{MOD_EXEC, (void *)(size_t)execute}, {0, NULL}};
static PyModuleDef definition = {{1, NULL}, NULL, 0, NULL, "hda", "A compiled robot arm.", sizeof(PyObject *), methods, slots, NULL, NULL, NULL};

extern __attribute__((visibility("default"))) PyObject *PyInit_hda(void);
PyObject *PyInit_hda(void) {
    return PyModuleDef_Init(&definition);
}
