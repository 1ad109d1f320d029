#include "core/merge.h"

#include <assert.h>
#include <math.h>
#include <string.h>

/* Pixels are merged in blocks, the last one padded; a block stays in the first-level cache, and
 * within it LANES pixels are merged at a time. Vectors are the compilers' own, so that one text
 * serves every instruction set, and lanes never mix, so that every one gives the same bits. */
enum { BLOCK = 256, LANES = 8, EXPOSURES = LS_MERGE_MAX_EXPOSURES };

#define PADDING 0xff

#define INLINE static inline __attribute__((always_inline))

#if defined(__clang__)
#define UNROLL _Pragma("unroll")
#else
#define UNROLL _Pragma("GCC unroll 8")
#endif

typedef float floats __attribute__((vector_size(LANES * 4)));
typedef int32_t ints __attribute__((vector_size(LANES * 4)));
typedef uint16_t shorts __attribute__((vector_size(LANES * 2)));

/* The parameters as the kernel wants them: float, exposures ascending. */
struct model {
    uint32_t n;
    uint32_t order[EXPOSURES]; /* sorted -> caller's index */
    float t[EXPOSURES];
    float low, high, clip; /* DN */
    float noise, shot;     /* sigma^2 = noise + shot max(E t, 0), DN^2 */
    float scale, scale2;   /* DN -> full scale, and its square */
    int variance;          /* wanted */
};

struct block {
    uint16_t x[EXPOSURES][BLOCK]; /* DN */
    float dark[EXPOSURES][BLOCK]; /* DN */
    float e[BLOCK], variance[BLOCK];
    int32_t validity[BLOCK];
};

static void model_init(struct model *m, const struct ls_merge_params *p, int variance)
{
    m->n = p->n_exposures;
    for (uint32_t i = 0; i < m->n; i++) {
        uint32_t k = i;
        for (; k > 0 && p->exposure_s[m->order[k - 1]] > p->exposure_s[i]; k--)
            m->order[k] = m->order[k - 1];
        m->order[k] = i;
    }
    for (uint32_t i = 0; i < m->n; i++)
        m->t[i] = (float)p->exposure_s[m->order[i]];
    m->low = (float)(p->range_low * p->full_scale_dn);
    m->high = (float)(p->range_high * p->full_scale_dn);
    m->clip = (float)p->clip_dn;
    m->noise = (float)(p->read_noise_dn * p->read_noise_dn + 1.0 / 12);
    m->shot = (float)(1 / p->electrons_per_dn);
    m->scale = (float)(1 / p->full_scale_dn);
    m->scale2 = m->scale * m->scale;
    m->variance = variance;
}

/* Macros, not functions: a vector argument's calling convention depends on the instruction set. */
#define SELECT(mask, a, b) ((floats)(((ints)(a) & (mask)) | ((ints)(b) & ~(mask))))
#define KEEP(mask, a) ((floats)((ints)(a) & (mask)))
#define POSITIVE(a) KEEP((a) > 0, a)
#define VARIANCE(m, signal) ((m)->noise + (m)->shot * POSITIVE(signal))

/* Merge the LANES pixels from `p` on: n is a constant in every instance. */
INLINE void merge_lanes(const struct model *m, struct block *b, int p, uint32_t n)
{
    floats y[EXPOSURES], dark[EXPOSURES];
    floats sum = {0}, norm = {0}, e;
    ints live[EXPOSURES];

    UNROLL for (uint32_t i = 0; i < n; i++)
    {
        shorts x16;
        memcpy(&x16, &b->x[i][p], sizeof x16);
        memcpy(&dark[i], &b->dark[i][p], sizeof dark[i]);
        floats x = __builtin_convertvector(__builtin_convertvector(x16, ints), floats);
        live[i] = x < m->clip;
        y[i] = x - dark[i];
        sum += KEEP(live[i], y[i]);
        norm += KEEP(live[i], (floats){0} + m->t[i]);
    }
    e = KEEP(norm > 0, sum / norm);

    sum = norm = (floats){0};
    UNROLL for (uint32_t i = 0; i < n; i++)
    {
        floats weight = KEEP(live[i], m->t[i] / VARIANCE(m, e * m->t[i]));
        sum += weight * y[i];
        norm += weight * m->t[i];
    }
    e = KEEP(norm > 0, sum / norm);

    /* The fallback starts as the shortest exposure and moves to each longer one that is not high,
     * so it ends as the longest that is not high, or the shortest if all are. */
    ints any_in = {0}, any_high = {0}, any_low = {0};
    floats y_back = y[0], t_back = (floats){0} + m->t[0];
    sum = norm = (floats){0};
    UNROLL for (uint32_t i = 0; i < n; i++)
    {
        floats expected = dark[i] + e * m->t[i];
        ints high = ~live[i] | (expected > m->high);
        ints low = ~high & (expected < m->low);
        ints in = ~(high | low);
        floats weight = KEEP(in, m->t[i] / VARIANCE(m, e * m->t[i]));
        sum += weight * y[i];
        norm += weight * m->t[i];
        any_in |= in;
        any_high |= high;
        any_low |= low;
        y_back = SELECT(high, y_back, y[i]);
        t_back = SELECT(high, t_back, (floats){0} + m->t[i]);
    }
    floats result = m->scale * SELECT(any_in, sum / norm, y_back / t_back);
    ints validity = ~any_in & ((any_high & 1) | (any_low & 2));
    memcpy(&b->e[p], &result, sizeof result);
    memcpy(&b->validity[p], &validity, sizeof validity);
    if (m->variance) {
        floats v_back = VARIANCE(m, y_back) / t_back / t_back;
        floats variance = m->scale2 * SELECT(any_in, 1 / norm, v_back);
        memcpy(&b->variance[p], &variance, sizeof variance);
    }
}

INLINE void merge_n(const struct model *m, struct block *b, uint32_t n)
{
    for (int p = 0; p < BLOCK; p += LANES)
        merge_lanes(m, b, p, n);
}

INLINE void merge_block(const struct model *m, struct block *b)
{
#define INSTANCE(n)       \
    case n:               \
        merge_n(m, b, n); \
        break;
    switch (m->n) {
        INSTANCE(1)
        INSTANCE(2)
        INSTANCE(3)
        INSTANCE(4)
        INSTANCE(5)
        INSTANCE(6)
        INSTANCE(7)
        INSTANCE(8)
    }
#undef INSTANCE
}

#if defined(__x86_64__) && !defined(LS_PORTABLE)
__attribute__((target("avx2"))) static void merge_block_avx2(const struct model *m, struct block *b)
{
    merge_block(m, b);
}
#endif

static void merge_block_any(const struct model *m, struct block *b)
{
#if defined(__x86_64__) && !defined(LS_PORTABLE)
    if (__builtin_cpu_supports("avx2")) {
        merge_block_avx2(m, b);
        return;
    }
#endif
    merge_block(m, b);
}

static void load(const struct model *m, const struct ls_merge_params *p,
                 const struct ls_merge_spans *s, size_t first, size_t n, size_t at, struct block *b)
{
    for (uint32_t i = 0; i < m->n; i++) {
        uint32_t k = m->order[i];
        ls_pixel_unpack(p->format, s->raw[k], first, n, &b->x[i][at]);
        if (s->dark[k])
            memcpy(&b->dark[i][at], s->dark[k] + first, n * sizeof(float));
        else
            memset(&b->dark[i][at], 0, n * sizeof(float));
    }
}

/* Give the pixels after the first n of a block harmless values. */
static void pad(const struct model *m, struct block *b, size_t n)
{
    for (uint32_t i = 0; i < m->n; i++) {
        memset(&b->x[i][n], 0, (BLOCK - n) * sizeof(uint16_t));
        memset(&b->dark[i][n], 0, (BLOCK - n) * sizeof(float));
    }
}

static void merge_span(const struct model *m, const struct ls_merge_params *p,
                       const struct ls_merge_spans *s, size_t first, size_t n)
{
    struct block b;
    uint8_t flags[BLOCK];

    load(m, p, s, first, n, 0, &b);
    pad(m, &b, n);
    merge_block_any(m, &b);
    memcpy(s->e + first, b.e, n * sizeof *b.e);
    for (int k = 0; k < BLOCK; k++)
        flags[k] = (uint8_t)b.validity[k];
    memcpy(s->validity + first, flags, n);
    if (s->variance)
        memcpy(s->variance + first, b.variance, n * sizeof *b.variance);
}

static size_t defect_lower_bound(const struct ls_merge_params *p, size_t pixel)
{
    size_t low = 0, high = p->n_defects;

    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (p->defects[middle] < pixel)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static int is_defect(const struct ls_merge_params *p, size_t pixel)
{
    size_t k = defect_lower_bound(p, pixel);
    return k < p->n_defects && p->defects[k] == pixel;
}

/* The good same-colour neighbours `ring` periods left, right, above and below, as bits 0..3. */
static unsigned good_neighbours(const struct ls_merge_params *p, size_t pixel, unsigned ring,
                                size_t at[4])
{
    size_t d = (size_t)ring * ls_cfa_period_px(p->format->cfa);
    size_t x = pixel % p->width, y = pixel / p->width;
    int inside[4] = {x >= d, x + d < p->width, y >= d, y + d < p->height};
    unsigned good = 0;

    at[0] = pixel - d;
    at[1] = pixel + d;
    at[2] = pixel - d * p->width;
    at[3] = pixel + d * p->width;
    for (unsigned k = 0; k < 4; k++)
        if (inside[k] && !is_defect(p, at[k]))
            good |= 1u << k;
    return good;
}

static uint8_t worse(uint8_t a, uint8_t b)
{
    static const uint8_t rank[] = {
        [LS_VALIDITY_OK] = 0,
        [LS_VALIDITY_DARK] = 1,
        [LS_VALIDITY_GAP] = 2,
        [LS_VALIDITY_SATURATED] = 3,
    };
    return rank[a] >= rank[b] ? a : b;
}

/* Of two whole pairs keep the one along the weaker gradient. */
static unsigned pick_pair(unsigned good, const float e[4])
{
    if (good != 0xf)
        return good;
    return fabsf(e[0] - e[1]) <= fabsf(e[2] - e[3]) ? 0x3 : 0xc;
}

static void replace(const struct ls_merge_spans *s, size_t pixel, const struct block *b,
                    unsigned good)
{
    float e = 0, variance = 0;
    uint8_t validity = LS_VALIDITY_OK;
    int n = 0;

    good = pick_pair(good, b->e);
    for (unsigned k = 0; k < 4; k++) {
        if (!(good >> k & 1))
            continue;
        e += b->e[k];
        variance += s->variance ? b->variance[k] : 0;
        validity = worse(validity, (uint8_t)b->validity[k]);
        n++;
    }
    s->e[pixel] = e / (float)n;
    s->validity[pixel] = validity;
    if (s->variance)
        s->variance[pixel] = variance / (float)(n * n);
}

/* Neighbours are merged afresh, so that a band needs no other band's output. */
static int correct(const struct model *m, const struct ls_merge_params *p,
                   const struct ls_merge_spans *s, size_t pixel)
{
    for (unsigned ring = 1; ring <= LS_MERGE_DEFECT_RINGS; ring++) {
        struct block b;
        size_t at[4];
        unsigned good = good_neighbours(p, pixel, ring, at);
        if (!good)
            continue;
        pad(m, &b, 0);
        for (unsigned k = 0; k < 4; k++)
            if (good >> k & 1)
                load(m, p, s, at[k], 1, k, &b);
        merge_block_any(m, &b);
        replace(s, pixel, &b, good);
        return 1;
    }
    return 0;
}

static void count(const uint8_t *validity, size_t n, struct ls_merge_stats *stats)
{
    uint8_t block[BLOCK];

    for (size_t at = 0; at < n; at += BLOCK) {
        size_t k = n - at < BLOCK ? n - at : BLOCK;
        memcpy(block, validity + at, k);
        memset(block + k, PADDING, BLOCK - k);
        for (unsigned v = 0; v < 4; v++) {
            uint32_t sum = 0;
            for (int p = 0; p < BLOCK; p++)
                sum += block[p] == v;
            stats->count[v] += sum;
        }
    }
}

void ls_merge_rows(const struct ls_merge_params *params, const struct ls_merge_spans *spans,
                   uint32_t first_row, uint32_t n_rows, struct ls_merge_stats *stats)
{
    struct model m;
    size_t begin = (size_t)first_row * params->width;
    size_t end = begin + (size_t)n_rows * params->width;
    uint64_t corrected = 0, uncorrectable = 0;

    assert(params->n_exposures >= 1 && params->n_exposures <= EXPOSURES);
    assert(first_row <= params->height && n_rows <= params->height - first_row);
    model_init(&m, params, spans->variance != NULL);
    for (size_t at = begin; at < end; at += BLOCK)
        merge_span(&m, params, spans, at, end - at < BLOCK ? end - at : BLOCK);
    for (size_t k = defect_lower_bound(params, begin);
         k < params->n_defects && params->defects[k] < end; k++) {
        int ok = correct(&m, params, spans, params->defects[k]);
        corrected += ok;
        uncorrectable += !ok;
    }
    if (!stats)
        return;
    count(spans->validity + begin, end - begin, stats);
    stats->corrected += corrected;
    stats->uncorrectable += uncorrectable;
}

void ls_merge(const struct ls_merge_params *params, const struct ls_merge_spans *spans,
              struct ls_merge_stats *stats)
{
    ls_merge_rows(params, spans, 0, params->height, stats);
}
