/* Efforts of the rows of a motion, given in turn, into a file:  answers MOTION OUT.  Ends with 1 where one is refused. */

#include "arm.h"
#include <stdio.h>

enum { ROW = ARM_NQ + 2 * ARM_NV };

static union { double align[8]; unsigned char bytes[ARM_SIZE + ARM_ALIGNMENT]; } room;

int main(int argc, char **argv)
{
    static double row[ROW], tau[ARM_NV];
    unsigned char *memory = room.bytes + (ARM_ALIGNMENT - (uintptr_t)room.bytes % ARM_ALIGNMENT) % ARM_ALIGNMENT;
    if (argc != 3 || ARM(start)(memory, ARM_SIZE, ARM_LAYOUT) != 0) return 3;
    FILE *motion = fopen(argv[1], "rb"), *out = fopen(argv[2], "wb");
    if (motion == NULL || out == NULL) return 3;
    while (fread(row, sizeof row, 1, motion) == 1) {
        if (ARM_CALL(memory, row, row + ARM_NQ, row + ARM_NQ + ARM_NV, tau) != 0) return 1;
        if (fwrite(tau, sizeof tau, 1, out) != 1) return 3;
    }
    fclose(motion);
    return fclose(out) == 0 ? 0 : 3;
}
