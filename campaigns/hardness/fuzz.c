/* Calls of an exported library with whatever comes: right numbers and wrong ones, in blocks that were begun and others.

       fuzz MOTION CALLS SEED

   Each call is one of calls.h, drawn by lot.  What it answers must be a status of the library; a refused one leaves the block as it
   was, so that the call after it answers what a copy of the block from before answers; and a block that begins again has its
   digits.  Ends with 1 where that is not so; how often each function answered each status is printed. */

#include "arm.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ROW = ARM_NQ + 2 * ARM_NV, MOST_SAMPLES = 140, STATUSES = ${statuses}, RESTARTED = 200, PROBED = 3 };

static double *rows;
static size_t row_count;
static uint64_t state = 88172645463325252u;
static unsigned char *begun, *other, *kept, *moved;   /* blocks; the second is never begun */

static uint64_t draw(uint64_t below)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (state >> 8) % below;
}

static double draw_number(void)
{
    static const double odd[] = {0.0, -0.0, NAN, INFINITY, -INFINITY, 5e-324, 1e300, -1e300, 1e-300, 1e18, 1.0, -1.0};
    double part = (double)draw(1u << 30) / (1u << 30);
    if (draw(12) == 0) return odd[draw(sizeof odd / sizeof odd[0])];
    return (2.0 * part - 1.0) * pow(10.0, (double)draw(7) - 4.0);
}

/* Room for so many numbers, which ends where they end. */
static double *make_room(size_t count)
{
    double *numbers = malloc(count * sizeof *numbers + (count == 0));
    if (numbers == NULL) exit(3);
    for (size_t i = 0; i < count; ++i) numbers[i] = 7.0;
    return numbers;
}

/* Numbers by lot; or, of the motion, those of a row from a column on, as often as there are samples. */
static double *draw_numbers(size_t count, size_t samples, int column, size_t row)
{
    double *numbers = make_room(count * samples);
    for (size_t i = 0; i < count * samples; ++i)
        numbers[i] = column < 0 ? draw_number() : rows[(row + i / count) % row_count * ROW + (size_t)column + i % count];
    if (column < 0 && draw(3) == 0)
        for (size_t i = 0; i < count * samples; ++i) numbers[i] = fabs(numbers[i]);
    return numbers;
}

static size_t draw_index(void)
{
    switch (draw(12)) {
    case 0: return SIZE_MAX;
    case 1: return (size_t)draw(UINT64_C(1) << 40);
    default: return (size_t)draw(6);
    }
}

static unsigned char *draw_block(void)
{
    switch (draw(24)) {
    case 0: return NULL;
    case 1: return begun + 8;
    case 2: return other;
    case 3: memcpy(moved, begun, ARM_SIZE); return moved;
    default: return begun;
    }
}

static size_t draw_size(void)
{
    static const size_t sizes[] = {ARM_SIZE, ARM_SIZE, ARM_SIZE, ARM_SIZE + 64, ARM_SIZE - 1, 0, SIZE_MAX};
    return sizes[draw(sizeof sizes / sizeof sizes[0])];
}

static int draw_layout(void) { return draw(4) != 0 ? ARM_LAYOUT : (int)draw(UINT32_MAX); }

/* One call of a function; -1 for those that return no status. */
#include "calls.h"

static unsigned char *make_block(void)
{
    void *block = NULL;
    if (posix_memalign(&block, ARM_ALIGNMENT, ARM_SIZE) != 0) exit(3);
    memset(block, 0, ARM_SIZE);
    return block;
}

static int probe(unsigned char *block, double *tau)
{
    const double *row = rows;
    for (size_t i = 0; i < ARM_NV; ++i) tau[i] = 0.0;
    return ARM_CALL(block, row, row + ARM_NQ, row + ARM_NQ + ARM_NV, tau);
}

/* Efforts of a block that begins anew. */
static void begin_again(double *tau)
{
    if (ARM(start)(begun, ARM_SIZE, ARM_LAYOUT) != 0) exit(1);
    for (int k = 0; k < PROBED; ++k)
        if (probe(begun, tau + k * ARM_NV) != 0) exit(1);
    if (ARM(start)(begun, ARM_SIZE, ARM_LAYOUT) != 0) exit(1);
}

/* Whether a block goes on as the copy of it from before a call that was refused, where that goes on at all. */
static int goes_on(double tolerance)
{
    static double now[ARM_NV], before[ARM_NV];
    double largest = 0.0, apart = 0.0;
    int expected = probe(kept, before), found;
    if (ARM(copy)(begun, moved, ARM_SIZE) != 0) return 0;
    found = probe(moved, now);
    if (expected != 0) return 1;   /* a march that is refused begins the next step without the trend of those before */
    if (found != 0) return 0;
    for (size_t i = 0; i < ARM_NV; ++i) {
        largest = fmax(largest, fabs(before[i]));
        apart = fmax(apart, fabs(now[i] - before[i]));
    }
    return apart <= tolerance * largest;
}

int main(int argc, char **argv)
{
    static unsigned long answers[FUNCTIONS][STATUSES];
    static double first[PROBED * ARM_NV], again[PROBED * ARM_NV];
    if (argc != 4) return 3;
    FILE *file = fopen(argv[1], "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) return 3;
    row_count = (size_t)ftell(file) / (ROW * sizeof *rows);
    rows = malloc(row_count * ROW * sizeof *rows);
    rewind(file);
    if (rows == NULL || row_count == 0 || fread(rows, ROW * sizeof *rows, row_count, file) != row_count) return 3;
    fclose(file);
    size_t calls = (size_t)atoll(argv[2]);
    state += (uint64_t)atoll(argv[3]) * UINT64_C(0x9e3779b97f4a7c15);
    begun = make_block(), other = make_block(), kept = make_block(), moved = make_block();
    begin_again(first);
    for (size_t k = 0; k < calls; ++k) {
        if (k % RESTARTED == 0) {
            begin_again(again);
            if (memcmp(first, again, sizeof first) != 0) {
                printf("call %zu: a block that begins again has other digits\n", k);
                return 1;
            }
        }
        int live = ARM(copy)(begun, kept, ARM_SIZE) == 0;
        size_t function = (size_t)draw(FUNCTIONS);
        int status = call(function);
        if (status < -1 || status >= STATUSES) {
            printf("call %zu: %s answers %d\n", k, NAMES[function], status);
            return 1;
        }
        if (status >= 0) ++answers[function][status];
        if (status == ARM_FAILED) {
            printf("call %zu: %s answers FAILED\n", k, NAMES[function]);
            return 1;
        }
        int ends = status == ARM_ENERGY || (BEGINS[function] && status >= ARM_NOT_FINITE);
        if (live && status > 0 && !ends && !goes_on(ARM_TOLERANCE)) {
            printf("call %zu: %s answers %d and leaves another block\n", k, NAMES[function], status);
            return 1;
        }
        if (ARM(copy)(begun, moved, ARM_SIZE) != 0 && ARM(start)(begun, ARM_SIZE, ARM_LAYOUT) != 0) return 1;
    }
    for (size_t function = 0; function < FUNCTIONS; ++function)
        for (int status = 0; status < STATUSES; ++status)
            if (answers[function][status]) printf("%s %d %lu\n", NAMES[function], status, answers[function][status]);
    free(begun), free(other), free(kept), free(moved), free(rows);
    return 0;
}
