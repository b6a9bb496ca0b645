/* The least that a detector costs pixel by pixel: built by peers_loop.py, once for AVX2 and once for AVX-512.

   One Philox-4x32-10 block for two pixels, counted electrons by inversion below 20 and by Cornish-Fisher above, read noise by Box and
   Muller, and one store. Everything stays in registers from the first word to the digital number, other effects are left out, and
   nothing asks whether one is on. The random words are in another order than in starloop, so the bits differ; the laws are the same. */

#include <immintrin.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __AVX512F__
#define LANES 16
typedef __m512 reals;
typedef __m512i words;
typedef __mmask16 mask;
#define F(name) _mm512_##name##_ps
#define I(name) _mm512_##name
#define LOAD_I(p) _mm512_loadu_si512(p)
#define XOR _mm512_xor_si512
#define AND _mm512_and_si512
#define OR _mm512_or_si512
#define FLOOR(x) _mm512_roundscale_ps(x, 9)
#define LESS(a, b) _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ)
#define ANY(m) ((m) != 0)
#define SET64(x) _mm512_set1_epi64((long long)(x))
#define PICK(m, yes, no) _mm512_mask_blend_ps(m, no, yes)
#define AS_F _mm512_castsi512_ps
#define AS_I _mm512_castps_si512
static inline void store_dn(uint16_t *to, words dn) { _mm256_storeu_si256((__m256i *)to, _mm512_cvtusepi32_epi16(dn)); }
#else
#define LANES 8
typedef __m256 reals;
typedef __m256i words;
typedef __m256 mask;
#define F(name) _mm256_##name##_ps
#define I(name) _mm256_##name
#define LOAD_I(p) _mm256_loadu_si256((const __m256i *)(p))
#define XOR _mm256_xor_si256
#define AND _mm256_and_si256
#define OR _mm256_or_si256
#define FLOOR(x) _mm256_floor_ps(x)
#define LESS(a, b) _mm256_cmp_ps(a, b, _CMP_LT_OQ)
#define ANY(m) (_mm256_movemask_ps(m) != 0)
#define SET64(x) _mm256_set1_epi64x((long long)(x))
#define PICK(m, yes, no) _mm256_blendv_ps(no, yes, m)
#define AS_F _mm256_castsi256_ps
#define AS_I _mm256_castps_si256
static inline void store_dn(uint16_t *to, words dn) {
    __m128i packed = _mm_packus_epi32(_mm256_castsi256_si128(dn), _mm256_extracti128_si256(dn, 1));
    _mm_storeu_si128((__m128i *)to, packed);
}
#endif

#define SET(x) F(set1)(x)
#define MUL F(mul)
#define ADD F(add)
#define SUB F(sub)
#define FMA F(fmadd)

/* Sum of c[i] x^i, the highest power first. */
static inline reals polynomial(reals x, const float *c, int count) {
    reals p = SET(c[0]);
    for (int i = 1; i < count; i++)
        p = FMA(p, x, SET(c[i]));
    return p;
}

/* Natural logarithm: exponent and the series of 2 atanh((m - 1) / (m + 1)). */
static inline reals logarithm(reals x) {
    static const float SERIES[5] = {2.0f / 9, 2.0f / 7, 2.0f / 5, 2.0f / 3, 2.0f};
    words root = I(set1_epi32)(0x3f3504f3), bits = I(sub_epi32)(AS_I(x), root);
    reals exponent = F(cvtepi32)(I(srai_epi32)(bits, 23));
    reals m = AS_F(I(add_epi32)(AND(bits, I(set1_epi32)(0x007fffff)), root));
    reals s = F(div)(SUB(m, SET(1)), ADD(m, SET(1)));
    return FMA(exponent, SET(0.69314718f), MUL(s, polynomial(MUL(s, s), SERIES, 5)));
}

/* exp(-x), 0 <= x <= 80. */
static inline reals exp_of_minus(reals x) {
    static const float SERIES[8] = {1.0f / 5040, 1.0f / 720, 1.0f / 120, 1.0f / 24, 1.0f / 6, 0.5f, 1, 1};
    reals k = FLOOR(FMA(x, SET(-1.44269504f), SET(0.5f)));
    reals r = FMA(k, SET(2.12194440e-4f), FMA(k, SET(-0.693359375f), SUB(SET(0), x)));
    words power = I(slli_epi32)(I(add_epi32)(I(cvtps_epi32)(k), I(set1_epi32)(127)), 23);
    return MUL(polynomial(r, SERIES, 8), AS_F(power));
}

static inline reals unit_of(words w) { return MUL(F(cvtepi32)(I(srli_epi32)(w, 8)), SET(1.0f / 16777216)); }
static inline reals open_unit_of(words w) { return MUL(ADD(F(cvtepi32)(I(srli_epi32)(w, 9)), SET(0.5f)), SET(1.0f / 8388608)); }

/* Two normal deviates from two words. */
static inline void normal_pair(words a, words b, reals *first, reals *second) {
    static const float SINE[5] = {1.0f / 362880, -1.0f / 5040, 1.0f / 120, -1.0f / 6, 1};
    static const float COSINE[6] = {-1.0f / 3628800, 1.0f / 40320, -1.0f / 720, 1.0f / 24, -0.5f, 1};
    reals radius = F(sqrt)(MUL(SET(-2), logarithm(open_unit_of(a)))), u = unit_of(b);
    reals quarter = FLOOR(FMA(u, SET(4), SET(0.5f)));
    reals x = MUL(FMA(quarter, SET(-0.25f), u), SET(6.2831853f)), t = MUL(x, x);
    reals s = MUL(x, polynomial(t, SINE, 5)), c = polynomial(t, COSINE, 6);
    words q = I(cvtps_epi32)(quarter);
    reals odd = F(cvtepi32)(AND(q, I(set1_epi32)(1)));
    mask swap = LESS(SET(0.5f), odd);
    words sign_s = I(slli_epi32)(AND(q, I(set1_epi32)(2)), 30);
    words sign_c = I(slli_epi32)(AND(I(add_epi32)(q, I(set1_epi32)(1)), I(set1_epi32)(2)), 30);
    *first = MUL(radius, AS_F(XOR(AS_I(PICK(swap, s, c)), sign_c)));
    *second = MUL(radius, AS_F(XOR(AS_I(PICK(swap, c, s)), sign_s)));
}

/* Four words for each of LANES / 2 counters from `first` on, in the low halves of 64 bits. */
static inline void philox(uint32_t first, uint32_t frame, uint32_t seed, words out[4]) {
    uint64_t counters[LANES / 2];
    for (int i = 0; i < LANES / 2; i++)
        counters[i] = first + (uint32_t)i;
    words c[4] = {LOAD_I(counters), SET64(frame), SET64(0), SET64(0)};
    words m0 = SET64(0xd2511f53), m1 = SET64(0xcd9e8d57);
    uint32_t k0 = seed, k1 = 0;
    for (int round = 0; round < 10; round++) {
        words p0 = I(mul_epu32)(m0, c[0]), p1 = I(mul_epu32)(m1, c[2]);
        c[0] = XOR(XOR(I(srli_epi64)(p1, 32), c[1]), SET64(k0));
        c[2] = XOR(XOR(I(srli_epi64)(p0, 32), c[3]), SET64(k1));
        c[1] = p1;
        c[3] = p0;
        k0 += 0x9e3779b9u;
        k1 += 0xbb67ae85u;
    }
    for (int i = 0; i < 4; i++)
        out[i] = c[i];
}

/* The low halves of `a` in even lanes and those of `b` in odd ones. */
static inline words both(words a, words b) { return OR(AND(a, SET64(0xffffffff)), I(slli_epi64)(b, 32)); }

/* Counts by summing the terms of Poisson's law until every uniform is passed. */
static inline reals inversion(reals mean, reals u) {
    reals term = exp_of_minus(mean), sum = term, count = SET(0), one = SET(1);
    for (int k = 1; k < 64; k++) {
        mask below = LESS(u, sum);
        count = ADD(count, PICK(below, SET(0), one));
        term = MUL(term, MUL(mean, SET(1.0f / (float)k)));
        sum = ADD(sum, term);
        if (k % 4 == 0 && !ANY(LESS(sum, u)))
            break;
    }
    return count;
}

/* Normal quantile of `u` (Giles 2010), then Cornish and Fisher's count. */
static inline reals cornish_fisher(reals mean, reals u) {
    static const float NEAR[9] = {2.8102264e-8f, 3.4327394e-7f, -3.5233877e-6f, -4.3915065e-6f, 2.1858087e-4f,
                                  -1.25372503e-3f, -4.17768164e-3f, 0.246640727f, 1.50140941f};
    static const float FAR[9] = {-2.00214257e-4f, 1.00950558e-4f, 1.34934322e-3f, -3.67342844e-3f, 5.73950773e-3f,
                                 -7.6224613e-3f, 9.43887047e-3f, 1.00167406f, 2.83297682f};
    reals w = SUB(SET(0), logarithm(MUL(MUL(SET(4), u), SUB(SET(1), u))));
    reals far = SUB(F(sqrt)(F(max)(w, SET(0))), SET(3));
    reals p = PICK(LESS(w, SET(5)), polynomial(SUB(w, SET(2.5f)), NEAR, 9), polynomial(far, FAR, 9));
    reals z = MUL(MUL(SET(1.41421356f), p), SUB(ADD(u, u), SET(1))), zz = MUL(z, z);
    reals s = F(sqrt)(SUB(mean, SET(1.0f / 12)));
    reals tail = F(div)(MUL(z, SUB(SET(1), zz)), MUL(SET(72), s));
    reals x = ADD(FMA(s, z, mean), FMA(SUB(zz, SET(1)), SET(1.0f / 6), ADD(tail, SET(0.5f))));
    return F(max)(FLOOR(x), SET(0));
}

static inline reals counted(reals mean, words w) {
    mask dim = LESS(mean, SET(20)), bright = LESS(SET(19.999999f), mean);
    reals count = SET(0);
    if (ANY(dim))
        count = inversion(PICK(dim, mean, SET(0)), F(min)(unit_of(w), SET(1 - 1.0f / 1048576)));
    if (ANY(bright))
        count = PICK(dim, count, cornish_fisher(F(max)(mean, SET(1)), open_unit_of(w)));
    return count;
}

/* Lanes of a vector of pixels. */
int lanes(void) { return LANES; }

/* Mean electrons -> digital numbers. A row of `mean` has `stride` floats; `size` is a multiple of 2 LANES. */
void bound_noise(const float *mean, int size, int stride, const float *prnu, const float *dsnu, float dark, float read, float gain,
                 float black, uint32_t seed, uint16_t *out) {
    float per_e = 1.0f / gain;
#pragma omp parallel for schedule(static)
    for (int j = 0; j < size; j++)
        for (int i = 0; i < size; i += 2 * LANES) {
            size_t at = (size_t)j * size + i;
            words a[4], b[4];
            philox((uint32_t)(at / 2), 1, seed, a);
            philox((uint32_t)(at / 2) + LANES / 2, 1, seed, b);
            reals normal[2];
            normal_pair(both(a[0], b[0]), both(a[1], b[1]), &normal[0], &normal[1]);
            words shot[2] = {both(a[2], a[3]), both(b[2], b[3])};
            for (int half = 0; half < 2; half++) {
                size_t pixel = at + (size_t)half * LANES;
                reals light = F(loadu)(mean + (size_t)j * stride + i + half * LANES);
                reals e = counted(FMA(light, F(loadu)(prnu + pixel), ADD(light, SET(dark))), shot[half]);
                e = ADD(FMA(SET(read), normal[half], e), F(loadu)(dsnu + pixel));
                reals dn = F(min)(F(max)(FMA(e, SET(per_e), SET(black)), SET(0)), SET(65535));
                store_dn(out + pixel, I(cvtps_epi32)(dn));
            }
        }
}
