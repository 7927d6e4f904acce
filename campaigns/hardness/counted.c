/* Single steps of an exported library under callgrind, which writes down the instructions of each: a line for each says what it was.

       counted MOTION STEPS WILD

   Rows of MOTION are given in turn.  A payload, where the library has one, is put on and taken off every 500 steps; the step in
   the middle is one that is refused, and then made as it should be.  Then come WILD steps to random places, each from a copy. */

#include "arm.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ROW = ARM_NQ + 2 * ARM_NV, CHANGED = 500 };

static union { double align[8]; unsigned char bytes[ARM_SIZE + ARM_ALIGNMENT]; } rooms[2];

static unsigned char *blocks[2];
static double tau[ARM_NV];

/* What is measured, and nothing else. */
__attribute__((noinline)) int measured_call(void *memory, const double *row)
{
    return ARM_CALL(memory, row, row + ARM_NQ, row + ARM_NQ + ARM_NV, tau);
}

static void make_call(const char *what, unsigned char *memory, const double *row)
{
    int status = measured_call(memory, row);
    unsigned long long iterations = 0;
#ifdef ARM_ITERATIONS
    memcpy(&iterations, memory + ARM_ITERATIONS, sizeof iterations);
#endif
    printf("%s %d %llu\n", what, status, iterations);
}

static double draw(double scale)
{
    static uint64_t state = 88172645463325252u;
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return scale * (2.0 * (double)(state >> 11) / 9007199254740992.0 - 1.0);
}

static void change_payload(unsigned char *memory, size_t times)
{
#ifdef ARM_PAYLOAD
    static const double centre[3] = {0.0, 0.0, 0.0}, none[6] = {0}, ball[6] = {1e-6, 1e-6, 1e-6, 0.0, 0.0, 0.0};
    int puts = times % 2 == 1;
    if (ARM(set_payload)(memory, ARM_PAYLOAD, puts ? ARM_MASS : 0.0, centre, puts ? ball : none) != 0) exit(4);
#else
    (void)memory, (void)times;
#endif
}

int main(int argc, char **argv)
{
    static double row[ROW];
    if (argc != 4) return 3;
    FILE *file = fopen(argv[1], "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) return 3;
    size_t count = (size_t)ftell(file) / sizeof row, steps = (size_t)atoll(argv[2]), wild = (size_t)atoll(argv[3]);
    double *rows = malloc(count * sizeof row);
    rewind(file);
    if (rows == NULL || count == 0 || fread(rows, sizeof row, count, file) != count) return 3;
    for (size_t k = 0; k < 2; ++k)
        blocks[k] = rooms[k].bytes + (ARM_ALIGNMENT - (uintptr_t)rooms[k].bytes % ARM_ALIGNMENT) % ARM_ALIGNMENT;
    if (ARM(start)(blocks[0], ARM_SIZE, ARM_LAYOUT) != 0) return 3;
    for (size_t k = 0; k < steps; ++k) {
        if (k > 0 && k % CHANGED == 0) change_payload(blocks[0], k / CHANGED);
        memcpy(row, rows + k % count * ROW, sizeof row);
        if (k == steps / 2) {
            if (ARM(copy)(blocks[0], blocks[1], ARM_SIZE) != 0) return 3;
            for (size_t i = 0; i < ARM_NQ; ++i) row[i] += 2.0;
            make_call("refused", blocks[0], row);
            if (ARM_RESTORES && ARM(copy)(blocks[1], blocks[0], ARM_SIZE) != 0) return 3;
            memcpy(row, rows + k % count * ROW, sizeof row);
        }
        make_call("step", blocks[0], row);
    }
    for (size_t k = 0; k < wild; ++k) {
        double scale = k % 3 == 0 ? 1.0 : k % 3 == 1 ? 0.1 : 0.01;
        if (ARM(copy)(blocks[0], blocks[1], ARM_SIZE) != 0) return 3;
        memcpy(row, rows + steps % count * ROW, sizeof row);
        for (size_t i = 0; i < ARM_NQ; ++i) row[i] += draw(scale);
        for (size_t i = 0; i < ARM_NV; ++i) row[ARM_NQ + i] += draw(100.0 * scale), row[ARM_NQ + ARM_NV + i] += draw(1e5 * scale);
        make_call("wild", blocks[1], row);
    }
    return 0;
}
