#include "core/grey_sphere_work.h"

#include "core/merge.h"

#include <stdlib.h>
#include <string.h>

/* ---- the sums of single lights ---- */

enum ls_err ls_grey_sums_begin(struct ls_grey_work *w, struct ls_grey_sums *s)
{
    const struct ls_sphere_view *view = w->grey->cameras[w->camera].view;
    *s = (struct ls_grey_sums){.pattern = calloc(LS_GREY_PATTERNS, sizeof *s->pattern)};
    if (!s->pattern)
        return ls_fail(w->diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
    for (uint32_t i = 0; i < w->rig->n_pictures; i++) {
        const struct ls_lit_picture *p = &w->rig->pictures[i];
        if (p->channel != w->channel || p->light >= 0)
            continue;
        if (s->n == LS_GREY_PATTERNS)
            return ls_fail(w->diag, LS_ERR_LIMIT,
                           "the take has more than %d pictures of patterns in %s", LS_GREY_PATTERNS,
                           w->rig->channels[w->channel].name);
        s->pattern[s->n++] = p;
    }
    s->sum = calloc((size_t)s->n * view->n + 1, sizeof *s->sum);
    s->validity = calloc((size_t)s->n * view->n + 1, 1);
    return s->sum && s->validity
               ? LS_OK
               : ls_fail(w->diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
}

void ls_grey_sums_end(struct ls_grey_sums *s)
{
    free(s->pattern);
    free(s->sum);
    free(s->validity);
}

void ls_grey_sums_add(const struct ls_grey_work *w, uint32_t light, const float *e,
                      const uint8_t *validity)
{
    const struct ls_sphere_view *view = w->grey->cameras[w->camera].view;
    const struct ls_grey_sums *s = w->sums;
    for (uint32_t k = 0; k < s->n; k++) {
        float weight = s->pattern[k]->weights[light];
        float *sum = s->sum + (size_t)k * view->n;
        uint8_t *worst = s->validity + (size_t)k * view->n;
        for (uint32_t j = 0; weight > 0 && j < view->n; j++) {
            uint32_t at = view->pixels[j].index;
            sum[j] += weight * e[at];
            if (validity[at] != LS_VALIDITY_OK && validity[at] != LS_VALIDITY_DARK)
                worst[j] = validity[at];
        }
    }
}

/* ---- the patterns ---- */

static enum ls_err use_pattern(void *user, const struct ls_lit_picture *picture, const float *e,
                               const uint8_t *validity, struct ls_diag *diag)
{
    struct ls_grey_work *w = user;
    struct ls_grey *grey = w->grey;
    const struct ls_sphere_view *view = grey->cameras[w->camera].view;
    size_t from = (size_t)w->sums->at++ * view->n;
    struct ls_pattern_factor factor;
    struct ls_diag inner = {{0}};
    for (uint32_t j = 0; j < view->n; j++) {
        w->whole[view->pixels[j].index] = w->sums->sum[from + j];
        w->whole_validity[view->pixels[j].index] = w->sums->validity[from + j];
    }
    if (ls_pattern_factor(view, w->whole, w->whole_validity, e, validity, picture->duty, &factor,
                          &inner))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "%s: %.300s", picture->id, inner.text);
    struct ls_grey_factor *out = &grey->factors[grey->n_factors++];
    *out = (struct ls_grey_factor){picture->channel, "", picture->duty, factor, 1};
    memcpy(out->pattern, picture->pattern, sizeof out->pattern);
    return LS_OK;
}

enum ls_err ls_grey_factors(struct ls_grey_work *w)
{
    return w->source->read(w->source->user, w->camera, w->sums->pattern, w->sums->n,
                           &w->grey->cameras[w->camera].outline, use_pattern, w, w->diag);
}

static bool same_class(const struct ls_grey_factor *a, const struct ls_grey_factor *b)
{
    return a->channel == b->channel && !strcmp(a->pattern, b->pattern) &&
           ls_calibration_same_duty(a->duty, b->duty);
}

enum ls_err ls_grey_combine(struct ls_grey *grey, uint32_t first, struct ls_diag *diag)
{
    uint32_t kept = first;
    LS_CLEANUP_FREE struct ls_pattern_factor *each =
        calloc(grey->n_factors - first + 1, sizeof *each);
    enum ls_err err = each ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
    for (uint32_t i = first; i < grey->n_factors && !err; i++) {
        struct ls_grey_factor head = grey->factors[i];
        uint32_t n = 0;
        bool known = false;
        for (uint32_t j = first; j < kept; j++)
            known |= same_class(&grey->factors[j], &head);
        for (uint32_t j = i; j < grey->n_factors && !known; j++)
            if (same_class(&grey->factors[j], &head))
                each[n++] = grey->factors[j].value;
        if (known)
            continue;
        head.pictures = n;
        err = ls_pattern_factor_combine(each, n, &head.value, diag);
        grey->factors[kept++] = head;
    }
    grey->n_factors = kept;
    return err;
}
