/* Inverse dynamics of models/double_pendulum as an FMU (FMI 2.0), model exchange and co-simulation: a function of its inputs.
 * With -DLATE the co-simulation answers one step late, as FMUs of tools do.  With -DWRONG the lower rod has its mass twice. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

#define G 9.81
#ifdef WRONG
#define M2 1.0
#else
#define M2 0.5
#endif

typedef struct { double in[6], out[2]; } Model; /* pivot q, qd, qdd, knee q, qd, qdd; pivot tau, knee tau */

static void evaluate(Model *m) {
    const double m1 = 1.0, l1 = 1.0, c1 = 0.5, c2 = 0.4, i1 = 1.0 / 12.0, i2 = M2 * 0.64 / 12.0;
    const double q1 = m->in[0], v1 = m->in[1], a1 = m->in[2], q2 = m->in[3], v2 = m->in[4], a2 = m->in[5];
    const double c = cos(q2), s = sin(q2), h = M2 * l1 * c2 * s, g2 = M2 * c2 * G * sin(q1 + q2);
    const double m22 = i2 + M2 * c2 * c2, m12 = m22 + M2 * l1 * c2 * c;
    const double m11 = i1 + m1 * c1 * c1 + i2 + M2 * (l1 * l1 + c2 * c2 + 2.0 * l1 * c2 * c);
    m->out[0] = m11 * a1 + m12 * a2 - h * (2.0 * v1 * v2 + v2 * v2) + (m1 * c1 + M2 * l1) * G * sin(q1) + g2;
    m->out[1] = m12 * a1 + m22 * a2 + h * v1 * v1 + g2;
}

fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions *f, fmi2Boolean v,
                              fmi2Boolean l) { return calloc(1, sizeof(Model)); }
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real x[]) {
    for (size_t k = 0; k < n; k++) if (vr[k] < 6) ((Model *)c)->in[vr[k]] = x[k]; else return fmi2Error;
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real x[]) {
    Model *m = c;
#ifndef LATE
    evaluate(m);
#endif
    for (size_t k = 0; k < n; k++) if (vr[k] < 8) x[k] = vr[k] < 6 ? m->in[vr[k]] : m->out[vr[k] - 6]; else return fmi2Error;
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean n) { evaluate(c); return fmi2OK; }

/* What the interface demands beside. */
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean l, size_t n, const fmi2String s[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real d, fmi2Boolean e, fmi2Real f) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { memset(c, 0, sizeof(Model)); return fmi2OK; }
#define NONE(name, type) \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2ValueReference v[], size_t n, type x[]) { return n ? fmi2Error : fmi2OK; } \
    fmi2Status fmi2Set##name(fmi2Component c, const fmi2ValueReference v[], size_t n, const type x[]) { return n ? fmi2Error : fmi2OK; }
NONE(Integer, fmi2Integer)
NONE(Boolean, fmi2Boolean)
NONE(String, fmi2String)
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s) { return fmi2Error; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { return fmi2Error; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) { return fmi2Error; }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) { return fmi2Error; }
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) { return fmi2Error; }
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s) { return fmi2Error; }
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference u[], size_t n, const fmi2ValueReference k[], size_t m,
                                        const fmi2Real d[], fmi2Real o[]) { return fmi2Error; }
fmi2Status fmi2EnterEventMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *e) { memset(e, 0, sizeof *e); return fmi2OK; }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean n, fmi2Boolean *e, fmi2Boolean *t) { *e = *t = 0; return fmi2OK; }
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t) { return fmi2OK; }
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real d[], size_t n) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real e[], size_t n) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer o[], const fmi2Real x[])
{ return fmi2Error; }
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer o[], fmi2Real x[])
{ return fmi2Error; }
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status *s) { return fmi2Discard; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real *x) { return fmi2Discard; }
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind k, fmi2Integer *x) { return fmi2Discard; }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean *x) { return fmi2Discard; }
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind k, fmi2String *x) { return fmi2Discard; }
