/* A brute-force loop over stars and positions, as a bound for a renderer that plans nothing: built by peers_loop.py.

   Every star is the product of a row and a column of Gaussian integrals over pixels, added to the image row by row. The compiler
   makes vectors of the inner loops, whose length LANES is given to it. Bands of rows are divided among threads. */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* The error function to 3e-7 (Abramowitz and Stegun 7.1.28). */
static inline float error_function(float x) {
    float a = fabsf(x);
    float p = 1.0f + a * (0.0705230784f + a * (0.0422820123f + a * (0.0092705272f + a * (0.0001520143f + a * (0.0002765672f + a * 0.0000430638f)))));
    p *= p;
    p *= p;
    p *= p;
    p *= p;
    return copysignf(1.0f - 1.0f / p, x);
}

/* Shares of a Gaussian in `used` pixels; the first edge is `first` px from its centre. The other lanes are 0. */
static inline void profile(float first, float scale, int used, float gain, float *shares) {
    float at[LANES + 1];
    for (int i = 0; i < LANES + 1; i++)
        at[i] = error_function((first + (float)i) * scale);
    for (int i = 0; i < LANES; i++)
        shares[i] = i < used ? gain * (at[i + 1] - at[i]) : 0.0f;
}

/* Draws all stars at all positions. A row of `image` has `stride` floats: LANES more than its `size` pixels, so that a whole vector
   may be added at the right edge. `reach`: half of a footprint, which may have LANES px. */
void draw(float *image, int size, int stride, const double *x, const double *y, const double *electrons, int stars,
          const double *path, int positions, double sigma, int reach, int bands) {
    float scale = (float)(sqrt(0.5) / sigma);
    int used = 2 * reach + 1;
#pragma omp parallel for schedule(dynamic)
    for (int band = 0; band < bands; band++) {
        int from = band * size / bands, to = (band + 1) * size / bands;
        memset(image + (size_t)from * stride, 0, sizeof(float) * (size_t)(to - from) * stride);
        for (int s = 0; s < stars; s++) {
            for (int p = 0; p < positions; p++) {
                double cx = x[s] + path[2 * p], cy = y[s] + path[2 * p + 1];
                int left = (int)floor(cx + 0.5) - reach, top = (int)floor(cy + 0.5) - reach;
                if (top >= to || top + used <= from || left >= size || left + used <= 0)
                    continue;
                float across[2 * LANES] = {0}, down[LANES];
                profile((float)(left - 0.5 - cx), scale, used, 0.5f * (float)(electrons[s] / positions), across);
                profile((float)(top - 0.5 - cy), scale, used, 0.5f, down);
                int skipped = left < 0 ? -left : 0, first = top < from ? from - top : 0, end = top + used > to ? to - top : used;
                for (int j = first; j < end; j++) {
                    float *row = image + (size_t)(top + j) * stride + left + skipped;
                    for (int i = 0; i < LANES; i++)
                        row[i] += down[j] * across[skipped + i];
                }
            }
        }
    }
}

/* Makes digital numbers with one Gaussian for all noise: its variance is that of light, dark signal and read noise. The Gaussian is a
   sum of four uniform numbers from a hash of the pixel, so its tails end at 3.5 sigma. */
void add_noise(const float *mean, int size, int stride, const float *prnu, const float *dsnu, float dark, float read, float gain,
               float black, uint32_t seed, uint16_t *out) {
    float per_e = 1.0f / gain, root_3 = 1.7320508f;
#pragma omp parallel for schedule(static)
    for (int j = 0; j < size; j++) {
        const float *light = mean + (size_t)j * stride;
        for (int i = 0; i < size; i++) {
            uint32_t at = (uint32_t)(j * size + i), words[2];
            for (int k = 0; k < 2; k++) {
                uint32_t word = (at * 2u + (uint32_t)k) * 0x9e3779b9u + seed;
                word = (word ^ (word >> 16)) * 0x85ebca6bu;
                word = (word ^ (word >> 13)) * 0xc2b2ae35u;
                words[k] = word ^ (word >> 16);
            }
            float sum = (float)(int)((words[0] & 0xffffu) + (words[0] >> 16) + (words[1] & 0xffffu) + (words[1] >> 16));
            float normal = (sum * (1.0f / 65536.0f) - 2.0f) * root_3;
            float e = light[i] * (1.0f + prnu[at]) + dark;
            e += dsnu[at] + normal * sqrtf(e + read * read);
            float number = e * per_e + black + 0.5f;
            number = number < 0.0f ? 0.0f : number > 65535.0f ? 65535.0f : number;
            out[at] = (uint16_t)(int)number;
        }
    }
}
