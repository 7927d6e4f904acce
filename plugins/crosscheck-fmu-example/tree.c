/* A rigid mechanism of revolute and prismatic joints as an FMU (FMI 2.0, model exchange and co-simulation).
 *
 * Its numbers are those of tree.h, which make_fmu.py writes from a case kit: COUNT, JOINTS, GRAVITY.
 * With closures (CLOSED of them) ties.h has those, and loop.h what they ask for; joints that are not given have no inputs.
 *     without -DFORWARD   inverse dynamics: inputs q, qd, qdd of every joint, outputs tau; a function, without states
 *     with -DFORWARD      forward dynamics: inputs tau, outputs q, states q, qd; co-simulation by Runge and Kutta's method of order 4
 * Value references: joint k has 4 k (q), 4 k + 1 (qd), 4 k + 2 (qdd), 4 k + 3 (tau).  Newton and Euler's equations in the world's
 * axes; the mass matrix from their torques under unit accelerations. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

typedef struct {
    int slides, parent; /* parent -1: the world */
    double place[3], turn[9], axis[3], rotor, damping, friction, stiffness, rest, mass, centre[3], inertia[9];
} Joint;
#include "tree.h"

#define STEPS 4 /* of Runge and Kutta's method within a communication step */
typedef struct { double value[4 * COUNT], guess[COUNT]; } Model;
typedef struct { double x[3], r[9], w[3], alpha[3], acc[3], f[3], n[3], axis[3]; } Seat;

static void cross(const double *a, const double *b, double *c) {
    const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    c[0] = x; c[1] = y; c[2] = z;
}
static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static void times(const double *m, const double *a, double *out) { for (int i = 0; i < 3; i++) out[i] = dot(m + 3 * i, a); }
static void back(const double *m, const double *a, double *out) {
    for (int i = 0; i < 3; i++) out[i] = m[i] * a[0] + m[3 + i] * a[1] + m[6 + i] * a[2];
}
static void product(const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}
static void rodrigues(const double *u, double q, double *r) { /* 1 + sin q [u] + (1 - cos q) [u]^2 */
    const double s = sin(q), c = 1.0 - cos(q), k[9] = {0, -u[2], u[1], u[2], 0, -u[0], -u[1], u[0], 0};
    double square[9];
    product(k, k, square);
    for (int i = 0; i < 9; i++) r[i] = (i % 4 == 0) + s * k[i] + c * square[i];
}
static void carry(const double *w, const double *alpha, const double *d, double *acc) { /* acc += alpha x d + w x (w x d) */
    double a[3], b[3];
    cross(alpha, d, a);
    cross(w, d, b);
    cross(w, b, b);
    for (int i = 0; i < 3; i++) acc[i] += a[i] + b[i];
}

static void inverse(const double *q, const double *v, const double *a, double *tau, Seat *seats) {
    static const double one[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, zero[3] = {0, 0, 0};
#ifdef WEIGHTLESS /* a mistake, for tests */
    const double up[3] = {0, 0, 0};
#else
    const double up[3] = {-GRAVITY[0], -GRAVITY[1], -GRAVITY[2]};
#endif
    for (int k = 0; k < COUNT; k++) {
        const Joint *j = &JOINTS[k];
        const Seat *p = j->parent < 0 ? NULL : &seats[j->parent];
        Seat *s = &seats[k];
        double offset[3], frame[9], local[9], d[3], t[3], m[3], own[3];
        times(p ? p->r : one, j->place, offset);
        product(p ? p->r : one, j->turn, frame);
        memcpy(s->w, p ? p->w : zero, sizeof s->w);
        memcpy(s->alpha, p ? p->alpha : zero, sizeof s->alpha);
        memcpy(s->acc, p ? p->acc : up, sizeof s->acc);
        carry(s->w, s->alpha, offset, s->acc);
        times(frame, j->axis, s->axis);
        cross(s->w, s->axis, t);
        if (j->slides) {
            for (int i = 0; i < 3; i++) { d[i] = s->axis[i] * q[k]; s->acc[i] += 2.0 * t[i] * v[k] + s->axis[i] * a[k]; }
            carry(s->w, s->alpha, d, s->acc);
            for (int i = 0; i < 3; i++) offset[i] += d[i];
            memcpy(s->r, frame, sizeof frame);
        } else {
            for (int i = 0; i < 3; i++) { s->alpha[i] += s->axis[i] * a[k] + t[i] * v[k]; s->w[i] += s->axis[i] * v[k]; }
            rodrigues(j->axis, q[k], local);
            product(frame, local, s->r);
        }
        for (int i = 0; i < 3; i++) s->x[i] = (p ? p->x[i] : 0.0) + offset[i];
        memcpy(t, s->acc, sizeof t);
        times(s->r, j->centre, d);
        carry(s->w, s->alpha, d, t);
        for (int i = 0; i < 3; i++) s->f[i] = j->mass * t[i];
        back(s->r, s->alpha, own);
        times(j->inertia, own, m);
        back(s->r, s->w, own);
        times(j->inertia, own, t);
        cross(own, t, own);
        for (int i = 0; i < 3; i++) m[i] += own[i];
        times(s->r, m, s->n);
        cross(d, s->f, t);
        for (int i = 0; i < 3; i++) s->n[i] += t[i];
    }
    for (int k = COUNT - 1; k >= 0; k--) {
        const Joint *j = &JOINTS[k];
        const Seat *s = &seats[k];
        tau[k] = dot(s->axis, j->slides ? s->f : s->n) + j->rotor * a[k] + j->damping * v[k] + j->stiffness * (q[k] - j->rest);
        tau[k] += j->friction * ((v[k] > 0) - (v[k] < 0));
        if (j->parent < 0) continue;
        Seat *p = &seats[j->parent];
        double d[3], t[3];
        for (int i = 0; i < 3; i++) d[i] = s->x[i] - p->x[i];
        cross(d, s->f, t);
        for (int i = 0; i < 3; i++) { p->f[i] += s->f[i]; p->n[i] += s->n[i] + t[i]; }
    }
}

#if CLOSED
#include "loop.h"
#endif

#ifdef FORWARD
static void rate(const double *state, const double *tau, double *out) { /* state q, qd: M qdd = tau - bias, by Cholesky's factors */
    double zero[COUNT] = {0}, unit[COUNT], bias[COUNT], m[COUNT][COUNT], *a = out + COUNT;
#ifdef CRASHING /* a mistake, for tests */
    abort();
#endif
    Seat seats[COUNT];
    inverse(state, state + COUNT, zero, bias, seats);
    for (int k = 0; k < COUNT; k++) {
        memset(unit, 0, sizeof unit);
        unit[k] = 1.0;
        inverse(state, state + COUNT, unit, m[k], seats);
        for (int i = 0; i < COUNT; i++) m[k][i] -= bias[i];
    }
    memcpy(out, state + COUNT, COUNT * sizeof(double));
    for (int i = 0; i < COUNT; i++) {
        for (int k = 0; k <= i; k++) {
            double s = m[i][k];
            for (int l = 0; l < k; l++) s -= m[i][l] * m[k][l];
            m[i][k] = i == k ? sqrt(s) : s / m[k][k];
        }
        a[i] = tau[i] - bias[i];
        for (int l = 0; l < i; l++) a[i] -= m[i][l] * a[l];
        a[i] /= m[i][i];
    }
    for (int i = COUNT - 1; i >= 0; i--) {
        for (int l = i + 1; l < COUNT; l++) a[i] -= m[l][i] * a[l];
        a[i] /= m[i][i];
    }
}
static void get(const Model *m, double *state, double *tau) {
    for (int k = 0; k < COUNT; k++) { state[k] = m->value[4 * k]; state[COUNT + k] = m->value[4 * k + 1]; tau[k] = m->value[4 * k + 3]; }
}
static void put(Model *m, const double *state) {
    for (int k = 0; k < COUNT; k++) { m->value[4 * k] = state[k]; m->value[4 * k + 1] = state[COUNT + k]; }
}
static void step(Model *m, double h) {
    double x[2 * COUNT], y[2 * COUNT], k[4][2 * COUNT], tau[COUNT];
    get(m, x, tau);
    for (int stage = 0; stage < 4; stage++) {
        const double part = stage == 0 ? 0.0 : stage == 3 ? h : h / 2;
        for (int i = 0; i < 2 * COUNT; i++) y[i] = x[i] + (stage ? part * k[stage - 1][i] : 0.0);
        rate(y, tau, k[stage]);
    }
    for (int i = 0; i < 2 * COUNT; i++) x[i] += h / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
    put(m, x);
}
#endif

fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions *f, fmi2Boolean v,
                              fmi2Boolean l) {
    Model *m = calloc(1, sizeof(Model));
#if CLOSED
    if (m) memcpy(m->guess, GUESS, sizeof m->guess);
#endif
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real x[]) {
    Model *m = c;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] >= 4 * COUNT) return fmi2Error;
        m->value[vr[k]] = x[k];
#if CLOSED
        if (vr[k] % 4 == 0 && !GIVEN[vr[k] / 4]) m->guess[vr[k] / 4] = x[k]; /* which of its branches a loop is in */
#endif
    }
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real x[]) {
    Model *m = c;
#ifndef FORWARD
    double q[COUNT], v[COUNT], a[COUNT], tau[COUNT];
    for (int k = 0; k < COUNT; k++) { q[k] = m->value[4 * k]; v[k] = m->value[4 * k + 1]; a[k] = m->value[4 * k + 2]; }
#if CLOSED
    for (int k = 0; k < COUNT; k++) if (!GIVEN[k]) q[k] = m->guess[k];
    if (!closed(q, v, a, tau)) return fmi2Error;
    memcpy(m->guess, q, sizeof q);
#else
    Seat seats[COUNT];
    inverse(q, v, a, tau, seats);
#endif
    for (int k = 0; k < COUNT; k++) m->value[4 * k + 3] = tau[k];
#endif
    for (size_t k = 0; k < n; k++) if (vr[k] < 4 * COUNT) x[k] = m->value[vr[k]]; else return fmi2Error;
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean n) {
#ifdef FORWARD
    for (int k = 0; k < STEPS; k++) step(c, h / STEPS);
#endif
    return fmi2OK;
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
#ifdef FORWARD
    double tau[COUNT];
    if (n == 2 * COUNT) { get(c, x, tau); return fmi2OK; }
#endif
    return n ? fmi2Error : fmi2OK;
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
#ifdef FORWARD
    if (n == 2 * COUNT) { put(c, x); return fmi2OK; }
#endif
    return n ? fmi2Error : fmi2OK;
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real d[], size_t n) {
#ifdef FORWARD
    double x[2 * COUNT], tau[COUNT];
    if (n == 2 * COUNT) { get(c, x, tau); rate(x, tau, d); return fmi2OK; }
#endif
    return n ? fmi2Error : fmi2OK;
}

/* What the interface demands beside. */
#define ANSWER(name, status, ...) fmi2Status name(__VA_ARGS__) { return status; }
#define NONE(type) \
    fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2##type x[]) { return n ? fmi2Error : fmi2OK; } \
    fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2##type x[]) { return n ? fmi2Error : fmi2OK; }
NONE(Integer)
NONE(Boolean)
NONE(String)
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
ANSWER(fmi2SetDebugLogging, fmi2OK, fmi2Component c, fmi2Boolean l, size_t n, const fmi2String s[])
ANSWER(fmi2SetupExperiment, fmi2OK, fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real d, fmi2Boolean e, fmi2Real f)
ANSWER(fmi2EnterInitializationMode, fmi2OK, fmi2Component c)
ANSWER(fmi2ExitInitializationMode, fmi2OK, fmi2Component c)
ANSWER(fmi2Terminate, fmi2OK, fmi2Component c)
fmi2Status fmi2Reset(fmi2Component c) { memset(((Model *)c)->value, 0, sizeof ((Model *)c)->value); return fmi2OK; }
ANSWER(fmi2GetFMUstate, fmi2Error, fmi2Component c, fmi2FMUstate *s)
ANSWER(fmi2SetFMUstate, fmi2Error, fmi2Component c, fmi2FMUstate s)
ANSWER(fmi2FreeFMUstate, fmi2Error, fmi2Component c, fmi2FMUstate *s)
ANSWER(fmi2SerializedFMUstateSize, fmi2Error, fmi2Component c, fmi2FMUstate s, size_t *n)
ANSWER(fmi2SerializeFMUstate, fmi2Error, fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n)
ANSWER(fmi2DeSerializeFMUstate, fmi2Error, fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
ANSWER(fmi2GetDirectionalDerivative, fmi2Error, fmi2Component c, const fmi2ValueReference u[], size_t n,
       const fmi2ValueReference k[], size_t m, const fmi2Real d[], fmi2Real o[])
ANSWER(fmi2EnterEventMode, fmi2OK, fmi2Component c)
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *e) { memset(e, 0, sizeof *e); return fmi2OK; }
ANSWER(fmi2EnterContinuousTimeMode, fmi2OK, fmi2Component c)
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean n, fmi2Boolean *e, fmi2Boolean *t) { *e = *t = 0; return fmi2OK; }
ANSWER(fmi2SetTime, fmi2OK, fmi2Component c, fmi2Real t)
ANSWER(fmi2GetEventIndicators, n ? fmi2Error : fmi2OK, fmi2Component c, fmi2Real e[], size_t n)
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    for (size_t k = 0; k < n; k++) x[k] = 1.0;
    return fmi2OK;
}
ANSWER(fmi2SetRealInputDerivatives, fmi2Error, fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer o[],
       const fmi2Real x[])
ANSWER(fmi2GetRealOutputDerivatives, fmi2Error, fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer o[],
       fmi2Real x[])
ANSWER(fmi2CancelStep, fmi2Error, fmi2Component c)
ANSWER(fmi2GetStatus, fmi2Discard, fmi2Component c, const fmi2StatusKind k, fmi2Status *s)
ANSWER(fmi2GetRealStatus, fmi2Discard, fmi2Component c, const fmi2StatusKind k, fmi2Real *x)
ANSWER(fmi2GetIntegerStatus, fmi2Discard, fmi2Component c, const fmi2StatusKind k, fmi2Integer *x)
ANSWER(fmi2GetBooleanStatus, fmi2Discard, fmi2Component c, const fmi2StatusKind k, fmi2Boolean *x)
ANSWER(fmi2GetStringStatus, fmi2Discard, fmi2Component c, const fmi2StatusKind k, fmi2String *x)
