/*
 * promotion_report: what the daemon says it did for each spectrum, kept and told on.
 * Layer: clients. Threads: the main thread. Ownership: holds copies; nothing to free.
 */
#ifndef LS_CLIENTS_PROMOTION_REPORT_H
#define LS_CLIENTS_PROMOTION_REPORT_H

#include "clients/lightstage.h"
#include "core/exr.h"

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_spectrum_said {
    char channel[32];
    enum lightstage_model model;
    enum lightstage_reference reference;
    uint32_t segments, inseparable_lights;
    bool blended;                          /* the segments' ratios, in place of a matrix */
    double left_out_error, left_out_share; /* share 0: no estimate */
    uint32_t multiplexed;                  /* 0: one by one */
    double spare_deviation;                /* sigmas */
    bool spare_alarm;
    uint32_t checked_lights; /* 0: no checks */
    double checked_error, highlight_error, highlight_share;
};

enum { LS_SPECTRA_SAID = 16 };

struct ls_promotion_report {
    uint32_t n;
    struct ls_spectrum_said spectrum[LS_SPECTRA_SAID];
};

/** Keep the first LS_SPECTRA_SAID; replaces what was kept. */
void ls_promotion_report_keep(struct ls_promotion_report *report,
                              const struct lightstage_spectrum *const *spectra, size_t n);

/** OpenEXR attributes: lightstage/model, the model by which any of the spectra was promoted, else
 * "measured"; lightstage/reference, what it was divided by, else "none"; lightstage/models, each
 * channel with its own, where there are several; lightstage/leftOutError, the largest, where
 * estimated; lightstage/checkedError and lightstage/highlightError likewise, where checked;
 * lightstage/blended, the channels that were blended, where any was.
 * @baseline: the tristimulus picture. Errors stay in attrs->err. */
void ls_promotion_report_attrs(const struct ls_promotion_report *report, bool baseline,
                               struct ls_exr_attrs *attrs);

/** [{channel, model, reference, ...}]. (transfer full). */
json_t *ls_promotion_report_json(const struct ls_promotion_report *report);

/** For a person, on standard output: one line per fitted or separated spectrum, and alarms of
 * multiplexed ones. */
void ls_promotion_report_print(const struct ls_promotion_report *report);

#endif
