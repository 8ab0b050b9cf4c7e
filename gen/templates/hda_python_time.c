/* What the Python module does over time: rollouts, windows, late readings, filters. Loops over time let go of the
 * interpreter. */
#include "hda.h"
#include "hda_python.h"
#include "hda_filters.h"

#include <limits.h>

/* rollout(kind, x0, u, c, dt, most, count, x): kind 0 smooth, 1 set-valued, 2 batch with shared c, 3 batch with its own
 * c each */
PyObject *hda_python_rollout(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 8) {
        PyErr_SetString(PyExc_TypeError, "rollout takes (kind, x0, u, c, dt, most, count, x)");
        return NULL;
    }
    const long kind = PyLong_AsLong(args[0]), many = PyLong_AsLong(args[6]);
    const double most = PyFloat_AsDouble(args[5]);
    if (PyErr_Occurred()) return NULL;
    if (kind < 0 || kind > 3 || many < 1 || (kind < 2 && many != 1) || !(most > 0.0)) {
        PyErr_SetString(PyExc_ValueError,
                        "rollout: kind is 0 to 3, count at least 1 (1 unless a batch), the longest step above 0");
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
    hda_entry e = {"rollout",
                   5,
                   NULL,
                   {
                       {"dt", 'd', rows, 0},
                       {"x0", 'd', many * HDA_NX, 0},
                       {"u", 'd', many * rows * HDA_NU, 0},
                       {"c", 'd', (kind == 3 ? many : 1) * HDA_NC, 0},
                       {"x", 'd', many * (rows + 1) * HDA_NX, 1},
                   }};
    PyObject *given[5] = {args[4], args[1], args[2], args[3], args[7]};
    Py_buffer views[HDA_MOST_ARRAYS];
    void *at[HDA_MOST_ARRAYS];
    Py_ssize_t stride[HDA_MOST_ARRAYS];
    const int taken = hda_take(&e, given, 5, 1, views, at, stride);
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
    return hda_none();
}

/* windows(begun, memory, edges, u, c, dt, jump, limit, x, most, count): windows that each begin anew, set-valued
 * friction, in `count` lanes with their own begun, memory, u, c, jump and x; memory and jump may be None */
PyObject *hda_python_windows(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 11) {
        PyErr_SetString(PyExc_TypeError, "windows takes (begun, memory, edges, u, c, dt, jump, limit, x, most, count)");
        return NULL;
    }
    const double most = PyFloat_AsDouble(args[9]);
    const long lanes = PyLong_AsLong(args[10]);
    if (PyErr_Occurred()) return NULL;
    if (!(most > 0.0) || lanes < 1) {
        PyErr_SetString(PyExc_ValueError, "windows: the longest step must be above 0, count at least 1");
        return NULL;
    }
    Py_buffer sized[2];
    if (PyObject_GetBuffer(args[2], &sized[0], C_CONTIGUOUS | FORMAT) < 0) return NULL;
    if (PyObject_GetBuffer(args[5], &sized[1], C_CONTIGUOUS | FORMAT) < 0) {
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
    /* the lengths below would overflow */
    if (!right || lanes > LONG_MAX / 8 / (rows + 1) / (HDA_NX + HDA_NU + HDA_NC)) {
        PyErr_SetString(PyExc_ValueError,
                        right ? "windows: count is larger than any array can be"
                              : "windows: edges must be rows [first, end) in rising order within those of dt");
        return NULL;
    }
    hda_entry e = {"windows",
                   7,
                   NULL,
                   {
                       {"begun", 'd', lanes * many * HDA_MECHANICAL, 0},
                       {"edges", 'i', many * 2, 0},
                       {"u", 'd', lanes * rows * HDA_NU, 0},
                       {"c", 'd', lanes * HDA_NC, 0},
                       {"dt", 'd', rows, 0},
                       {"limit", 'd', HDA_NX, 0},
                       {"x", 'd', lanes * within * HDA_NX, 1},
                   }};
    PyObject *given[9] = {args[0], args[2], args[3], args[4], args[5], args[7], args[8]};
    const hda_argument optional[2] = {{"memory", 'd', lanes * many * (HDA_NX - HDA_MECHANICAL), 0},
                                      {"jump", 'd', lanes * rows * HDA_NX, 0}};
    int at_optional[2] = {-1, -1};
    for (int k = 0; k < 2; k++) {
        PyObject *one = args[k ? 6 : 1];
        if (one == &_Py_NoneStruct) continue;
        at_optional[k] = e.count;
        e.arguments[e.count] = optional[k];
        given[e.count++] = one;
    }
    Py_buffer views[HDA_MOST_ARRAYS];
    void *at[HDA_MOST_ARRAYS];
    Py_ssize_t stride[HDA_MOST_ARRAYS];
    if (!hda_take(&e, given, e.count, 1, views, at, stride)) return NULL;
    const double *memory = at_optional[0] < 0 ? NULL : at[at_optional[0]],
                 *jump = at_optional[1] < 0 ? NULL : at[at_optional[1]];
    void *thread = PyEval_SaveThread();
    hda_rollout_windows_batch(at[0], memory, at[1], many, at[2], at[3], at[4], rows, most, jump, at[5], lanes, at[6]);
    PyEval_RestoreThread(thread);
    for (int k = 0; k < e.count; k++) PyBuffer_Release(&views[k]);
    return hda_none();
}

/* late(x, time, path, far, age, seen): `seen` made as old as the joints' encoders read */
PyObject *hda_python_late(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 6) {
        PyErr_SetString(PyExc_TypeError, "late takes (x, time, path, far, age, seen)");
        return NULL;
    }
    const double far = PyFloat_AsDouble(args[3]);
    if (PyErr_Occurred()) return NULL;
    Py_buffer time;
    if (PyObject_GetBuffer(args[1], &time, C_CONTIGUOUS | FORMAT) < 0) return NULL;
    const long rows = (long)(time.len / 8);
    PyBuffer_Release(&time);
    hda_entry e = {"late",
                   5,
                   NULL,
                   {
                       {"x", 'd', rows * HDA_NX, 0},
                       {"time", 'd', rows, 0},
                       {"path", 'i', rows, 0},
                       {"age", 'd', HDA_N, 0},
                       {"seen", 'd', rows * HDA_N, 1},
                   }};
    PyObject *given[5] = {args[0], args[1], args[2], args[4], args[5]};
    Py_buffer views[HDA_MOST_ARRAYS];
    void *at[HDA_MOST_ARRAYS];
    Py_ssize_t stride[HDA_MOST_ARRAYS];
    if (!hda_take(&e, given, 5, 1, views, at, stride)) return NULL;
    void *thread = PyEval_SaveThread();
    hda_late(at[0], at[1], at[2], rows, far, at[3], at[4]);
    PyEval_RestoreThread(thread);
    for (int k = 0; k < 5; k++) PyBuffer_Release(&views[k]);
    return hda_none();
}

/* filters(begun, extra, covariance, spans, u, time, c, measured, variance, read, places, spread, settings, found): the
 * bank over each of the spans (first row, last row); places: what the channels show, then the flexible joints;
 * settings: those of hda_bank */
PyObject *hda_python_filters(PyObject *module, PyObject *const *args, Py_ssize_t count) {
    (void)module;
    if (count != 14) {
        PyErr_SetString(PyExc_TypeError, "filters takes (begun, extra, covariance, spans, u, time, c, measured, "
                                         "variance, read, places, spread, settings, found)");
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
    const long many = sizes[0] / 8, rows = sizes[1] / 8, M = sizes[2] / 4 - HDA_FLEXIBLE,
               E = sizes[3] / 8 / HDA_FILTERS, D = HDA_MECHANICAL + E;
    if (many < 1 || rows < 2 || M < 1 || M > HDA_CHANNELS_MOST || E < HDA_EXTRA_LEAST || E > HDA_EXTRA_MOST) {
        PyErr_SetString(PyExc_ValueError,
                        "filters: a span, two rows and a channel at least, and the extra torques of this arm");
        return NULL;
    }
    hda_entry e = {"filters",
                   14,
                   NULL,
                   {
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
    Py_buffer views[HDA_MOST_ARRAYS];
    void *at[HDA_MOST_ARRAYS];
    Py_ssize_t stride[HDA_MOST_ARRAYS];
    if (!hda_take(&e, args, 14, 1, views, at, stride)) return NULL;
    const int *spans = at[3], *places = at[10];
    const double *settings = at[12], *of = settings + 3;
    const hda_bank bank = {(int)M,
                           (int)E,
                           places,
                           places + M,
                           at[9],
                           at[11],
                           settings,
                           of,
                           of + HDA_NX,
                           of + HDA_NX + HDA_MECHANICAL,
                           of + HDA_NX + HDA_MECHANICAL + HDA_N,
                           of + HDA_NX + HDA_MECHANICAL + 2 * HDA_N};
    int right = settings[2] > 0.0;
    for (long k = 0; k < many; k++)
        right &= spans[2 * k] >= 0 && spans[2 * k + 1] > spans[2 * k] && spans[2 * k + 1] < rows;
    for (long k = 0; k < M; k++) right &= places[k] >= 0 && places[k] < HDA_CHANNELS_MOST;
    for (int k = 0; k < HDA_FLEXIBLE; k++) right &= places[M + k] >= 0 && places[M + k] < HDA_N;
    void *thread = PyEval_SaveThread();
    for (long k = 0; right && k < many; k++) {
        hda_filter(&bank, (double *)at[0] + k * HDA_FILTERS * HDA_NX, (double *)at[1] + k * HDA_FILTERS * E,
                   (double *)at[2] + k * HDA_FILTERS * D * D, spans[2 * k], spans[2 * k + 1], at[4], at[5], at[6],
                   at[7], (double *)at[8] + k * M, (double *)at[13] + k * HDA_NX);
    }
    PyEval_RestoreThread(thread);
    for (int k = 0; k < 14; k++) PyBuffer_Release(&views[k]);
    if (!right) {
        PyErr_SetString(PyExc_ValueError, "filters: spans must be rows first < last within those of time, places those "
                                          "of channels and joints, the longest step above 0");
        return NULL;
    }
    return hda_none();
}
