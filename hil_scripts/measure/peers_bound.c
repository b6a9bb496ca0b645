/* The least that stars without motion cost, by hand for AVX2 and AVX-512: built by peers_loop.py.

   Clear a band of rows for each thread, then add every star of it as the product of a row and a column of Gaussian integrals. There is
   no plan, no choice of stars and no check of what they need: places and footprint are given. */

#include <immintrin.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#define LANES 16
#define AVX512 __attribute__((target("avx512f,avx512vl,avx512dq,avx512bw,fma,avx2")))
#define AVX2 __attribute__((target("avx2,fma")))

/* The error function to 3e-7 (Abramowitz and Stegun 7.1.28), from the highest power on. */
static const float POWERS[6] = {0.0000430638f, 0.0002765672f, 0.0001520143f, 0.0092705272f, 0.0422820123f, 0.0705230784f};

/* Inputs of one call. */
struct stars {
    float *image;
    int size, stride;
    const double *x, *y, *electrons;
    int count;
    float scale;
    int reach;
};

/* A star on the image. */
struct star {
    int left, top;
    float x, y, half;
};

static inline struct star star_at(const struct stars *s, int n) {
    struct star star;
    star.left = (int)floor(s->x[n] + 0.5) - s->reach;
    star.top = (int)floor(s->y[n] + 0.5) - s->reach;
    star.x = (float)(star.left - 0.5 - s->x[n]);
    star.y = (float)(star.top - 0.5 - s->y[n]);
    star.half = (float)(0.25 * s->electrons[n]);
    return star;
}

/* Rows of a star in a band, from the star's first one; 0 where it has none there or is over an edge of the image at the left. */
static inline int rows_of(const struct stars *s, const struct star *star, int from, int to, int *first) {
    int used = 2 * s->reach + 1, end = star->top + used > to ? to - star->top : used;
    *first = star->top < from ? from - star->top : 0;
    return star->left < s->size && star->left + used > 0 && end > *first ? end : 0;
}

/* What hangs over the left edge, one by one. */
static void add_at_the_edge(const struct stars *s, const struct star *star, const float *across, const float *down, int first, int end) {
    for (int j = first; j < end; j++)
        for (int i = -star->left; i < LANES; i++)
            s->image[(size_t)(star->top + j) * s->stride + star->left + i] += down[j] * across[i];
}

AVX512 static inline __m512 erf_512(__m512 x) {
    __m512 a = _mm512_abs_ps(x), p = _mm512_set1_ps(POWERS[0]);
    for (int i = 1; i < 6; i++)
        p = _mm512_fmadd_ps(p, a, _mm512_set1_ps(POWERS[i]));
    p = _mm512_fmadd_ps(p, a, _mm512_set1_ps(1.0f));
    for (int i = 0; i < 4; i++)
        p = _mm512_mul_ps(p, p);
    __m512 value = _mm512_sub_ps(_mm512_set1_ps(1.0f), _mm512_div_ps(_mm512_set1_ps(1.0f), p));
    return _mm512_or_ps(value, _mm512_and_ps(x, _mm512_set1_ps(-0.0f)));
}

AVX512 static inline __m512 shares_512(float first, float scale, float gain, __mmask16 used) {
    const __m512 numbers = _mm512_set_ps(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
    const __m512i next = _mm512_set_epi32(15, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1);
    __m512 edges = erf_512(_mm512_mul_ps(_mm512_add_ps(numbers, _mm512_set1_ps(first)), _mm512_set1_ps(scale)));
    __m512 wide = _mm512_sub_ps(_mm512_permutexvar_ps(next, edges), edges);
    return _mm512_maskz_mul_ps(used, wide, _mm512_set1_ps(gain));
}

AVX512 static void band_512(const struct stars *s, int from, int to) {
    __mmask16 used = (__mmask16)((1u << (2 * s->reach + 1)) - 1u);
    for (int n = 0; n < s->count; n++) {
        struct star star = star_at(s, n);
        int first, end = rows_of(s, &star, from, to, &first);
        if (end == 0)
            continue;
        __m512 across = shares_512(star.x, s->scale, star.half, used);
        float down[LANES] __attribute__((aligned(64)));
        _mm512_store_ps(down, shares_512(star.y, s->scale, 1.0f, used));
        if (star.left < 0) {
            float shares[LANES] __attribute__((aligned(64)));
            _mm512_store_ps(shares, across);
            add_at_the_edge(s, &star, shares, down, first, end);
            continue;
        }
        float *row = s->image + (size_t)(star.top + first) * s->stride + star.left;
        for (int j = first; j < end; j++, row += s->stride)
            _mm512_storeu_ps(row, _mm512_fmadd_ps(_mm512_set1_ps(down[j]), across, _mm512_loadu_ps(row)));
    }
}

AVX2 static inline __m256 erf_256(__m256 x) {
    const __m256 sign = _mm256_set1_ps(-0.0f);
    __m256 a = _mm256_andnot_ps(sign, x), p = _mm256_set1_ps(POWERS[0]);
    for (int i = 1; i < 6; i++)
        p = _mm256_fmadd_ps(p, a, _mm256_set1_ps(POWERS[i]));
    p = _mm256_fmadd_ps(p, a, _mm256_set1_ps(1.0f));
    for (int i = 0; i < 4; i++)
        p = _mm256_mul_ps(p, p);
    __m256 value = _mm256_sub_ps(_mm256_set1_ps(1.0f), _mm256_div_ps(_mm256_set1_ps(1.0f), p));
    return _mm256_or_ps(value, _mm256_and_ps(x, sign));
}

AVX2 static inline void shares_256(float first, float scale, float gain, const float *used, __m256 *low, __m256 *high) {
    const __m256 numbers = _mm256_set_ps(7, 6, 5, 4, 3, 2, 1, 0);
    const __m256i next = _mm256_set_epi32(0, 7, 6, 5, 4, 3, 2, 1);
    __m256 at = _mm256_add_ps(numbers, _mm256_set1_ps(first)), scales = _mm256_set1_ps(scale), gains = _mm256_set1_ps(gain);
    __m256 a = erf_256(_mm256_mul_ps(at, scales)), b = erf_256(_mm256_mul_ps(_mm256_add_ps(at, _mm256_set1_ps(8)), scales));
    __m256 wide_a = _mm256_sub_ps(_mm256_permutevar8x32_ps(_mm256_blend_ps(a, b, 1), next), a);
    __m256 wide_b = _mm256_sub_ps(_mm256_permutevar8x32_ps(b, next), b);
    *low = _mm256_mul_ps(wide_a, _mm256_mul_ps(gains, _mm256_loadu_ps(used)));
    *high = _mm256_mul_ps(wide_b, _mm256_mul_ps(gains, _mm256_loadu_ps(used + 8)));
}

AVX2 static void band_256(const struct stars *s, int from, int to) {
    float used[LANES];
    for (int i = 0; i < LANES; i++)
        used[i] = i < 2 * s->reach + 1 ? 1.0f : 0.0f;
    for (int n = 0; n < s->count; n++) {
        struct star star = star_at(s, n);
        int first, end = rows_of(s, &star, from, to, &first);
        if (end == 0)
            continue;
        __m256 low, high, down_low, down_high;
        float down[LANES] __attribute__((aligned(32)));
        shares_256(star.x, s->scale, star.half, used, &low, &high);
        shares_256(star.y, s->scale, 1.0f, used, &down_low, &down_high);
        _mm256_store_ps(down, down_low);
        _mm256_store_ps(down + 8, down_high);
        if (star.left < 0) {
            float shares[LANES] __attribute__((aligned(32)));
            _mm256_store_ps(shares, low);
            _mm256_store_ps(shares + 8, high);
            add_at_the_edge(s, &star, shares, down, first, end);
            continue;
        }
        float *row = s->image + (size_t)(star.top + first) * s->stride + star.left;
        for (int j = first; j < end; j++, row += s->stride) {
            __m256 gain = _mm256_set1_ps(down[j]);
            _mm256_storeu_ps(row, _mm256_fmadd_ps(gain, low, _mm256_loadu_ps(row)));
            _mm256_storeu_ps(row + 8, _mm256_fmadd_ps(gain, high, _mm256_loadu_ps(row + 8)));
        }
    }
}

/* Returns 1 where the processor has the level: 3 is AVX2, 4 is AVX-512. */
int has_level(int level) {
    return level == 4 ? __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") : __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}

/* Draws stars at one position. A row of `image` has `stride` floats, LANES more than its `size` pixels; `reach` is half of a
   footprint, 7 px at most. */
void bound(int level, float *image, int size, int stride, const double *x, const double *y, const double *electrons, int count,
           double sigma, int reach, int bands) {
    struct stars s = {image, size, stride, x, y, electrons, count, (float)(sqrt(0.5) / sigma), reach};
#pragma omp parallel for schedule(static)
    for (int band = 0; band < bands; band++) {
        int from = band * size / bands, to = (band + 1) * size / bands;
        memset(image + (size_t)from * stride, 0, sizeof(float) * (size_t)(to - from) * stride);
        if (level == 4)
            band_512(&s, from, to);
        else
            band_256(&s, from, to);
    }
}
