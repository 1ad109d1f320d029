#include "clients/promotion_report.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

void ls_promotion_report_keep(struct ls_promotion_report *report,
                              const struct lightstage_spectrum *const *spectra, size_t n)
{
    report->n = 0;
    for (size_t i = 0; i < n && report->n < LS_SPECTRA_SAID; i++) {
        const struct lightstage_spectrum *from = spectra[i];
        struct ls_spectrum_said *to = &report->spectrum[report->n];
        if (!lightstage_model_name(from->model) || !lightstage_reference_name(from->reference))
            continue; /* of a newer daemon */
        snprintf(to->channel, sizeof to->channel, "%s", from->channel);
        to->model = from->model;
        to->reference = from->reference;
        to->segments = from->segments;
        to->blended = from->blended;
        to->inseparable_lights = from->inseparable_lights;
        to->multiplexed = from->multiplexed;
        to->spare_deviation = from->spare_deviation;
        to->spare_alarm = from->spare_alarm;
        to->left_out_error = from->left_out_error;
        to->left_out_share = from->left_out_share;
        to->checked_lights = from->checked_lights;
        to->checked_error = from->checked_error;
        to->highlight_error = from->highlight_error;
        to->highlight_share = from->highlight_share;
        report->n++;
    }
}

static bool is_estimated(const struct ls_spectrum_said *said)
{
    return said->left_out_share > 0 && isfinite(said->left_out_error);
}

static bool is_checked(const struct ls_spectrum_said *said)
{
    return said->checked_lights > 0 && isfinite(said->checked_error);
}

static bool has_highlights(const struct ls_spectrum_said *said)
{
    return is_checked(said) && said->highlight_share > 0 && isfinite(said->highlight_error);
}

/* What a spectrum was divided by. */
static const char *reference_of(const struct ls_spectrum_said *said)
{
    return said->model == LIGHTSTAGE_MEASURED ? "none" : lightstage_reference_name(said->reference);
}

static const struct ls_spectrum_said *first_promoted(const struct ls_promotion_report *report)
{
    for (uint32_t i = 0; i < report->n; i++)
        if (report->spectrum[i].model != LIGHTSTAGE_MEASURED)
            return &report->spectrum[i];
    return NULL;
}

static void list_models(const struct ls_promotion_report *report, struct ls_exr_attrs *attrs)
{
    char text[LS_SPECTRA_SAID * 48] = "";
    for (uint32_t i = 0; i < report->n; i++) {
        size_t used = strlen(text);
        snprintf(text + used, sizeof text - used, "%s%s %s", i ? ", " : "",
                 report->spectrum[i].channel, lightstage_model_name(report->spectrum[i].model));
    }
    if (report->n > 1)
        ls_exr_attrs_string(attrs, "lightstage/models", text);
}

static void list_blended(const struct ls_promotion_report *report, struct ls_exr_attrs *attrs)
{
    char text[LS_SPECTRA_SAID * 34] = "";
    for (uint32_t i = 0; i < report->n; i++) {
        size_t used = strlen(text);
        if (report->spectrum[i].blended)
            snprintf(text + used, sizeof text - used, "%s%s", used ? ", " : "",
                     report->spectrum[i].channel);
    }
    if (text[0])
        ls_exr_attrs_string(attrs, "lightstage/blended", text);
}

/* The largest error of the spectra that have one. */
static void add_worst(const struct ls_promotion_report *report, struct ls_exr_attrs *attrs)
{
    double left_out = -1, checked = -1, highlight = -1;
    for (uint32_t i = 0; i < report->n; i++) {
        const struct ls_spectrum_said *said = &report->spectrum[i];
        left_out = is_estimated(said) ? fmax(left_out, said->left_out_error) : left_out;
        checked = is_checked(said) ? fmax(checked, said->checked_error) : checked;
        highlight = has_highlights(said) ? fmax(highlight, said->highlight_error) : highlight;
    }
    if (left_out >= 0)
        ls_exr_attrs_float(attrs, "lightstage/leftOutError", (float)left_out);
    if (checked >= 0)
        ls_exr_attrs_float(attrs, "lightstage/checkedError", (float)checked);
    if (highlight >= 0)
        ls_exr_attrs_float(attrs, "lightstage/highlightError", (float)highlight);
}

void ls_promotion_report_attrs(const struct ls_promotion_report *report, bool baseline,
                               struct ls_exr_attrs *attrs)
{
    const struct ls_spectrum_said *said = first_promoted(report);
    ls_exr_attrs_string(attrs, "lightstage/model",
                        baseline ? "tristimulus"
                        : said   ? lightstage_model_name(said->model)
                                 : "measured");
    ls_exr_attrs_string(attrs, "lightstage/reference",
                        said && !baseline ? reference_of(said) : "none");
    list_models(report, attrs);
    list_blended(report, attrs);
    add_worst(report, attrs);
}

static json_t *spectrum_json(const struct ls_spectrum_said *said)
{
    json_t *out = json_pack("{ss ss ss}", "channel", said->channel, "model",
                            lightstage_model_name(said->model), "reference", reference_of(said));
    if (said->segments > 0)
        json_object_set_new(out, "segments", json_integer(said->segments));
    if (said->model == LIGHTSTAGE_LINEAR)
        json_object_set_new(out, "blended", json_boolean(said->blended));
    if (is_estimated(said)) {
        json_object_set_new(out, "left_out_error", json_real(said->left_out_error));
        json_object_set_new(out, "left_out_share", json_real(said->left_out_share));
    }
    if (is_checked(said)) {
        json_object_set_new(out, "checked_lights", json_integer(said->checked_lights));
        json_object_set_new(out, "checked_error", json_real(said->checked_error));
    }
    if (has_highlights(said)) {
        json_object_set_new(out, "highlight_error", json_real(said->highlight_error));
        json_object_set_new(out, "highlight_share", json_real(said->highlight_share));
    }
    if (said->model == LIGHTSTAGE_SEPARATED)
        json_object_set_new(out, "inseparable_lights", json_integer(said->inseparable_lights));
    if (said->multiplexed > 0) {
        json_object_set_new(out, "multiplexed", json_integer(said->multiplexed));
        if (isfinite(said->spare_deviation))
            json_object_set_new(out, "spare_deviation", json_real(said->spare_deviation));
        json_object_set_new(out, "spare_alarm", json_boolean(said->spare_alarm));
    }
    return out;
}

json_t *ls_promotion_report_json(const struct ls_promotion_report *report)
{
    json_t *out = json_array();
    for (uint32_t i = 0; i < report->n; i++)
        json_array_append_new(out, spectrum_json(&report->spectrum[i]));
    return out;
}

void ls_promotion_report_print(const struct ls_promotion_report *report)
{
    for (uint32_t i = 0; i < report->n; i++) {
        const struct ls_spectrum_said *said = &report->spectrum[i];
        if (said->blended)
            printf("%s: one value a pixel: a blend of the ratios of %u segments, no matrix\n",
                   said->channel, said->segments);
        if (is_estimated(said))
            printf("%s: fitted on %u segments; each left out and predicted: %.2f %% off\n",
                   said->channel, said->segments, 100 * said->left_out_error);
        if (said->spare_alarm)
            printf("%s: alarm: where no light was lit, the multiplexed pictures show %.1f sigma: "
                   "other light came after the darks, something saturated, or the supply's sag is "
                   "not the calibrated one\n",
                   said->channel, said->spare_deviation);
        if (is_checked(said))
            printf("%s: held against %u lights photographed alone: %.2f %% off\n", said->channel,
                   said->checked_lights, 100 * said->checked_error);
        if (has_highlights(said))
            printf("%s: their highlights: %.2f %% off\n", said->channel,
                   100 * said->highlight_error);
        if (said->model == LIGHTSTAGE_SEPARATED && said->inseparable_lights > 0)
            printf("%s: %u lights are inseparable: promoted whole, by Eq. 1\n", said->channel,
                   said->inseparable_lights);
    }
}
