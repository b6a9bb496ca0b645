/* The integer arithmetic of starloop_protocol.c against the same in double precision: every count, every tie between two
 * counts and its neighbours, and norms of quaternions on both sides of their limits.
 *
 *   scaled          prints how much was compared; status 1 when something differs
 *   scaled float    the same against single precision, which is not exact: a control that must find differences
 */
#include <math.h>
#include <stdio.h>

#include "starloop_protocol.c"

static int is_control;

/* The nearest count by floating point; 0 when it does not fit. */
static int reference_counts(float value, uint32_t scale, unsigned bits, int32_t *counts) {
    double exact = is_control ? (double)(value * (1.0f / (float)scale) * (float)scale * (float)scale)
                              : (double)value / (1.0 / (double)scale);
    double nearest = exact < 0 ? exact - 0.5 : exact + 0.5;
    double limit = (double)((int32_t)1 << (bits - 1));
    if (!(nearest < limit && nearest > -limit)) return 0;
    *counts = (int32_t)nearest;
    return 1;
}

static int counts_differ(float value, uint32_t scale, unsigned bits) {
    int32_t got = 0, wanted = 0;
    int fits = to_counts(value, scale, bits, &got), should_fit = reference_counts(value, scale, bits, &wanted);
    return fits != should_fit || got != wanted;
}

static int value_differs(int32_t count, uint32_t scale, unsigned bits) {
    float wanted = (float)((double)count * (1.0 / (double)scale)), got;
    uint64_t word = (uint64_t)(uint32_t)count & (((uint64_t)1 << bits) - 1);
    return !unpack(word, scale, bits, 0, &got, 1) || got != wanted;
}

static unsigned long differences_of(uint32_t scale, unsigned bits, unsigned long *compared) {
    int32_t limit = ((int32_t)1 << (bits - 1)) - 1, count;
    unsigned long found = 0;
    int step;
    for (count = -limit; count <= limit; count++) {
        float tie = (float)(((double)count + 0.5) / (double)scale);
        float near[3];
        near[0] = nextafterf(tie, -INFINITY), near[1] = tie, near[2] = nextafterf(tie, INFINITY);
        for (step = 0; step < 3; step++) found += (unsigned long)counts_differ(near[step], scale, bits);
        found += (unsigned long)counts_differ((float)((double)count / (double)scale), scale, bits);
        found += (unsigned long)value_differs(count, scale, bits);
        *compared += 5;
    }
    return found;
}

/* A number from 0 to 1. */
static double next_random(uint64_t *state) {
    *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(*state >> 11) / 9007199254740992.0;
}

static double norm_of(const float q[4]) {
    double square = 0.0;
    int i;
    for (i = 0; i < 4; i++) square += (double)q[i] * (double)q[i];
    return sqrt(square);
}

/* Norms within 2e-9 of a limit may go either way; so close a norm is rare even here. */
static unsigned long differences_of_norms(unsigned long *compared) {
    uint64_t state = 1;
    unsigned long found = 0, i;
    for (i = 0; i < 400000; i++) {
        float q[4];
        int part;
        double target = 1.0 + (i % 2 ? 1e-3 : -1e-3) + 4e-6 * (next_random(&state) - 0.5), norm;
        for (part = 0; part < 4; part++) q[part] = (float)(next_random(&state) - 0.5);
        norm = norm_of(q);
        for (part = 0; part < 4; part++) q[part] = (float)(q[part] / norm * target);
        norm = norm_of(q);
        if (fabs(fabs(norm - 1.0) - 1e-3) < 2e-9) continue;
        found += (unsigned long)(is_unit(q) != (fabs(norm - 1.0) <= 1e-3));
        *compared += 1;
    }
    return found;
}

int main(int count, char **words) {
    static const float odd[] = {0.0f, -0.0f, 1e-45f, -1e-45f, 1e-38f, 8388608.0f, 1e30f, -1e30f, INFINITY, -INFINITY, NAN};
    unsigned long compared = 0, found = 0;
    size_t i;
    is_control = count > 1 && strcmp(words[1], "float") == 0;
    found += differences_of(RATE_COUNTS, RATE_BITS, &compared);
    found += differences_of(PAIR_COUNTS, PAIR_BITS, &compared);
    found += differences_of(BURST_COUNTS, 16, &compared);
    found += differences_of(SPEED_COUNTS, 16, &compared);
    found += differences_of_norms(&compared);
    for (i = 0; i < sizeof odd / sizeof odd[0]; i++) {
        found += (unsigned long)counts_differ(odd[i], RATE_COUNTS, RATE_BITS);
        found += (unsigned long)counts_differ(odd[i], SPEED_COUNTS, 16);
        compared += 2;
    }
    printf("%lu compared, %lu differ\n", compared, found);
    return found != 0;
}
