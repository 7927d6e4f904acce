/* Calls an FMU of FMI 3 as no importer should, under sanitizers: states, bytes that are none, numbers that cannot be.
   It is compiled with the source of the FMU in front of it. */

#include "fmu.c"

#include <stdio.h>

static int told;

static void log_words(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String words)
{
    (void)environment, (void)status, (void)category;
    told += words != NULL;
}

#define DEMAND(condition)                                    \
    if (!(condition)) {                                      \
        fprintf(stderr, "line %d: %s\n", __LINE__, #condition); \
        return 1;                                            \
    }

static double now(fmi3Instance c) { return ((struct instance *)c)->model.time; }

static fmi3Status step(fmi3Instance c)
{
    bool events, ends, early;
    double last;
    return fmi3DoStep(c, now(c), FIXED_STEP > 0.0 ? FIXED_STEP : 0.01, 1, &events, &ends, &early, &last);
}

/* Every input and every parameter gets every such number; the FMU refuses it or not, and its state brings it back. */
static int give_numbers(fmi3Instance c, fmi3FMUState state, const double *start)
{
    const double bad[] = {0.0 / 0.0, 1.0 / 0.0, 1e308, -1e308, 1e-320, -1.0, 1e9};
    for (fmi3ValueReference i = 0; i < VARIABLES; ++i) {
        if (ROLES[i] == 'o') continue;
        for (size_t k = 0; k < sizeof bad / sizeof bad[0]; ++k) {
            DEMAND(fmi3SetFloat64(c, &i, 1, bad + k, 1) == fmi3OK)
            if (step(c) == fmi3Error) DEMAND(fmi3SetFMUState(c, state) == fmi3OK)
            DEMAND(fmi3SetFloat64(c, &i, 1, start + i, 1) == fmi3OK)
        }
    }
    DEMAND(fmi3SetFMUState(c, state) == fmi3OK)
    DEMAND(step(c) == fmi3OK)
    return 0;
}

static int pass_bytes(fmi3Instance c, fmi3FMUState state)
{
    size_t size;
    fmi3FMUState other = NULL;
    DEMAND(fmi3SerializedFMUStateSize(c, state, &size) == fmi3OK)
    unsigned char *bytes = (unsigned char *)malloc(size);
    DEMAND(fmi3SerializeFMUState(c, state, bytes, size - 1) == fmi3Error)
    DEMAND(fmi3SerializeFMUState(c, state, bytes, size) == fmi3OK)
    DEMAND(fmi3DeserializeFMUState(c, bytes, size - 1, &other) == fmi3Error)
    for (int twice = 0; twice < 2; ++twice) DEMAND(fmi3DeserializeFMUState(c, bytes, size, &other) == fmi3OK)
    DEMAND(fmi3SetFMUState(c, other) == fmi3OK)
    DEMAND(step(c) == fmi3OK)
    bytes[0] ^= 1;
    DEMAND(fmi3DeserializeFMUState(c, bytes, size, &other) == fmi3Error)
    for (int twice = 0; twice < 2; ++twice) fmi3FreeFMUState(c, &other);
    free(bytes);
    return 0;
}

int main(void)
{
    DEMAND(fmi3InstantiateCoSimulation("x", "another", "", 0, 0, 0, 0, NULL, 0, NULL, log_words, NULL) == NULL)
    fmi3Instance c = fmi3InstantiateCoSimulation("x", TOKEN, "", 0, 0, 0, 0, NULL, 0, NULL, log_words, NULL);
    DEMAND(c != NULL && step(c) == fmi3Error)
    DEMAND(fmi3EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0) == fmi3OK && fmi3EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0) == fmi3Error)
    fmi3ValueReference every[VARIABLES + 1], beyond = VARIABLES + 1;
    double values[VARIABLES + 1];
    for (fmi3ValueReference i = 0; i <= VARIABLES; ++i) every[i] = i;
    DEMAND(fmi3GetFloat64(c, every, VARIABLES + 1, values, VARIABLES + 1) == fmi3OK)
    DEMAND(fmi3GetFloat64(c, &beyond, 1, values, 1) == fmi3Error && fmi3SetFloat64(c, &beyond, 1, values, 1) == fmi3Error)
    DEMAND(fmi3ExitInitializationMode(c) == fmi3OK)
    for (int k = 0; k < 3; ++k) DEMAND(step(c) == fmi3OK)
    fmi3FMUState state = NULL;
    DEMAND(fmi3GetFMUState(c, &state) == fmi3OK && fmi3GetFMUState(c, &state) == fmi3OK)
    if (pass_bytes(c, state) || give_numbers(c, state, values)) return 1;
    fmi3FreeFMUState(c, &state);
    DEMAND(fmi3SetFMUState(c, state) == fmi3Error)
    DEMAND(fmi3Reset(c) == fmi3OK && fmi3Terminate(c) == fmi3OK && step(c) == fmi3Error)
    fmi3FreeInstance(c);
    fmi3FreeInstance(NULL);
    printf("%d refusals in words\n", told);
    return told > 5 ? 0 : 1;
}
