/* Steps of an exported library, again and again: what they take of the system, and how long each lasts.

       steps MOTION COUNT THREADS [LATENCIES]

   MOTION holds rows of q, qd, qdd, which are given in turn.  The block stands between pages that nobody may touch, and ends where
   the second of them begins, so that a byte beyond what `size` states ends the program.  With no thread beside (THREADS = 1) the
   steps are made under seccomp's strict mode: any system call but read, write and exit ends the program, a request for memory, a
   lock that waits and a file among them.  Calls of malloc and its kin are counted. */

#define _GNU_SOURCE
#include "arm.h"
#include <linux/seccomp.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

enum { ROW = ARM_NQ + 2 * ARM_NV, MOST_THREADS = 8 };

static volatile unsigned long taken;   /* calls of malloc and its kin */

#ifdef COUNT_MALLOC
void *__libc_malloc(size_t);
void *__libc_calloc(size_t, size_t);
void *__libc_realloc(void *, size_t);
void *__libc_memalign(size_t, size_t);
void *malloc(size_t size) { ++taken; return __libc_malloc(size); }
void *calloc(size_t count, size_t size) { ++taken; return __libc_calloc(count, size); }
void *realloc(void *old, size_t size) { ++taken; return __libc_realloc(old, size); }
void *memalign(size_t to, size_t size) { ++taken; return __libc_memalign(to, size); }
void *aligned_alloc(size_t to, size_t size) { ++taken; return __libc_memalign(to, size); }
#endif

static double *rows;
static size_t row_count, step_count;
static float *latencies;

struct run { unsigned char *memory; uint64_t digest; unsigned long refused; };

static unsigned char *make_guarded_block(void)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE), inner = (ARM_SIZE + page - 1) / page * page;
    unsigned char *all = mmap(NULL, inner + 2 * page, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (all == MAP_FAILED || mprotect(all + page, inner, PROT_READ | PROT_WRITE) != 0) exit(3);
    memset(all + page, 0xa5, inner);
    return all + page + inner - ARM_SIZE;
}

/* Digits of all efforts in one number (FNV-1a over words). */
static void add_digits(uint64_t *digest, const double *tau)
{
    for (size_t i = 0; i < ARM_NV; ++i) {
        uint64_t word;
        memcpy(&word, tau + i, sizeof word);
        *digest = (*digest ^ word) * UINT64_C(1099511628211);
    }
}

static void *make_steps(void *given)
{
    struct run *run = given;
    double tau[ARM_NV];
    for (size_t k = 0; k < step_count; ++k) {
        const double *row = rows + k % row_count * ROW;
        struct timespec before, after;
        if (latencies) clock_gettime(CLOCK_MONOTONIC, &before);
        int status = ARM_CALL(run->memory, row, row + ARM_NQ, row + ARM_NQ + ARM_NV, tau);
        if (latencies) {
            clock_gettime(CLOCK_MONOTONIC, &after);
            latencies[k] = (float)((double)(after.tv_sec - before.tv_sec) + 1e-9 * (double)(after.tv_nsec - before.tv_nsec));
        }
        if (status != 0) ++run->refused;
        add_digits(&run->digest, tau);
    }
    return NULL;
}

static void read_rows(const char *path)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) exit(3);
    row_count = (size_t)ftell(file) / (ROW * sizeof *rows);
    rows = malloc(row_count * ROW * sizeof *rows);
    rewind(file);
    if (rows == NULL || row_count == 0 || fread(rows, ROW * sizeof *rows, row_count, file) != row_count) exit(3);
    fclose(file);
}

/* One thread after the other, or all at once. */
static void run_threads(struct run *runs, int count, int at_once)
{
    pthread_t threads[MOST_THREADS];
    for (int i = 0; i < count; ++i) {
        if (ARM(start)(runs[i].memory, ARM_SIZE, ARM_LAYOUT) != 0) exit(3);
        runs[i].digest = UINT64_C(14695981039346656037);
        runs[i].refused = 0;
        if (pthread_create(threads + i, NULL, make_steps, runs + i) != 0) exit(3);
        if (!at_once) pthread_join(threads[i], NULL);
    }
    for (int i = 0; at_once && i < count; ++i) pthread_join(threads[i], NULL);
}

int main(int argc, char **argv)
{
    static char line[200];
    if (argc < 4) return 3;
    read_rows(argv[1]);
    step_count = (size_t)atoll(argv[2]);
    int count = atoi(argv[3]);
    struct run runs[MOST_THREADS] = {{NULL, 0, 0}};
    if (count < 1 || count > MOST_THREADS) return 3;
    for (int i = 0; i < count; ++i) runs[i].memory = make_guarded_block();
    if (count > 1) {
        uint64_t alone[MOST_THREADS];
        run_threads(runs, count, 0);
        for (int i = 0; i < count; ++i) alone[i] = runs[i].digest;
        run_threads(runs, count, 1);
        for (int i = 0; i < count; ++i)
            if (runs[i].digest != alone[i] || runs[i].refused != 0) return 1;
        printf("steps %zu threads %d same 1\n", step_count, count);
        return 0;
    }
    size_t most = step_count > row_count ? step_count : row_count;
    if (argc > 4 && (latencies = calloc(most, sizeof *latencies)) == NULL) return 3;
    if (ARM(start)(runs[0].memory, ARM_SIZE, ARM_LAYOUT) != 0) return 3;
    unsigned long before = taken;
    if (latencies) {   /* once through the whole motion, which ends where it begins, before it counts */
        size_t all = step_count;
        step_count = row_count;
        make_steps(runs);
        step_count = all;
    } else if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_STRICT) != 0) {
        return 3;
    }
    make_steps(runs);
    unsigned long during = taken - before;
    if (latencies) {
        FILE *file = fopen(argv[4], "wb");
        if (file == NULL || fwrite(latencies, sizeof *latencies, step_count, file) != step_count || fclose(file) != 0) return 3;
        return runs[0].refused == 0 ? 0 : 1;
    }
    int length = snprintf(line, sizeof line, "steps %zu allocations %lu refused %lu\n", step_count, during, runs[0].refused);
    if (write(STDOUT_FILENO, line, (size_t)length) != length) syscall(SYS_exit, 3);
    syscall(SYS_exit, during == 0 && runs[0].refused == 0 ? 0 : 1);
}
