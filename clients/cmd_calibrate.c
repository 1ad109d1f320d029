#include "clients/calibrate_grey.h"
#include "clients/calibrate_options.h"
#include "clients/calibrate_probe.h"
#include "clients/calibrate_report.h"
#include "clients/calibrate_take.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const size_t base_bytes = (size_t)256 << 20, plan_bytes = (size_t)1 << 20;

/* The takes and what they said. */
struct calibration {
    struct ls_command_context *context;
    struct ls_calibrate_options *options;
    char ids[LS_N_OBJECTS][128];
    struct ls_calibrate_take *takes[LS_N_OBJECTS];                    /* by the first camera */
    struct ls_calibrate_take *grey_takes[LS_CALIBRATION_MAX_CAMERAS]; /* by each of them */
    char *plan;                                                       /* text */
    struct ls_grey *grey;
    struct ls_chrome chrome;
    struct ls_gloss gloss;
    struct ls_calibration *base, *result;
    struct ls_calibrate_remarks remarks;
};

/* What is not what it should be is an answer, not a failure of the program. */
static int failed(struct calibration *c, enum ls_err err)
{
    if (err == LS_ERR_ABORTED)
        return LS_EXIT_INTERRUPTED;
    int code = ls_command_failed(c->context, err);
    bool answer = err == LS_ERR_NOT_FOUND || err == LS_ERR_STATE;
    return answer ? LS_EXIT_NO : code;
}

static int shoot(struct calibration *c, enum ls_calibrate_object object, bool polarised)
{
    struct ls_calibrate_options *o = c->options;
    bool existing = o->takes[LS_OBJECT_GREY] != NULL;
    if (o->skip[object] || (existing && !o->takes[object]) ||
        (object == LS_OBJECT_GLOSS && !polarised))
        return LS_EXIT_OK;
    if (existing)
        snprintf(c->ids[object], sizeof c->ids[object], "%s", o->takes[object]);
    else {
        int code = ls_calibrate_shoot(c->context, &o->shoot, object, c->ids[object]);
        if (code)
            return code;
    }
    enum ls_err err =
        ls_calibrate_take_open(c->context, c->ids[object], o->cameras[0], &c->takes[object]);
    for (uint32_t k = 0; k < o->n_cameras && !err && object == LS_OBJECT_GREY; k++)
        err = ls_calibrate_take_open(c->context, c->ids[object], o->cameras[k], &c->grey_takes[k]);
    return err ? failed(c, err) : LS_EXIT_OK;
}

static enum ls_err same_camera(const struct calibration *c, enum ls_calibrate_object object)
{
    const struct ls_take_document *a = c->takes[LS_OBJECT_GREY]->document;
    const struct ls_take_document *b = c->takes[object]->document;
    if (a->n_lights == b->n_lights && a->n_channels == b->n_channels && a->width == b->width &&
        a->height == b->height)
        return LS_OK;
    return ls_fail(&c->context->diag, LS_ERR_MISMATCH,
                   "takes %s and %s are of different rigs or cameras", c->ids[LS_OBJECT_GREY],
                   c->ids[object]);
}

static int measure(struct calibration *c, enum ls_calibrate_object object)
{
    const struct ls_calibrate_take *take = c->takes[object];
    const struct ls_calibrate_options *o = c->options;
    if (!take)
        return LS_EXIT_OK;
    fprintf(stderr, "measuring %s\n", c->ids[object]);
    enum ls_err err = same_camera(c, object);
    if (!err && object == LS_OBJECT_GREY)
        err = ls_calibrate_grey((const struct ls_calibrate_take *const *)c->grey_takes,
                                o->n_cameras, o->radius_m, o->reflectance, &c->grey);
    if (!err && object == LS_OBJECT_CHROME)
        err = ls_calibrate_chrome(take, c->grey, o->reflectance, &c->chrome);
    if (!err && object == LS_OBJECT_GLOSS)
        err = ls_calibrate_gloss(take, c->grey, &c->gloss);
    return err ? failed(c, err) : LS_EXIT_OK;
}

static bool has_polarisers(const struct ls_take_document *d)
{
    uint32_t vertical, horizontal;
    return ls_take_document_polarisers(d, &vertical, &horizontal);
}

static int need_polarisers(const struct calibration *c)
{
    if (!c->options->takes[LS_OBJECT_GLOSS] || has_polarisers(c->takes[LS_OBJECT_GREY]->document))
        return LS_EXIT_OK;
    return ls_command_wrong("calibrate: --gloss measures polarisers, and the rig of take %s has no "
                            "pair of them: leave out --gloss",
                            c->ids[LS_OBJECT_GREY]);
}

/* Each is measured as soon as it has been photographed: who put the wrong object there hears of it
 * before the next. */
static int run_objects(struct calibration *c)
{
    bool polarised = true;
    int code = LS_EXIT_OK;
    for (int i = 0; i < LS_N_OBJECTS && !code; i++) {
        code = shoot(c, (enum ls_calibrate_object)i, polarised);
        if (!code && i == LS_OBJECT_GREY)
            code = need_polarisers(c);
        if (!code)
            code = measure(c, (enum ls_calibrate_object)i);
        if (!code && i == LS_OBJECT_GREY)
            polarised = has_polarisers(c->takes[i]->document);
    }
    return code;
}

static int read_plan(struct calibration *c)
{
    struct ls_calibrate_options *o = c->options;
    size_t n = 0;
    if (o->plan && ls_command_read_file(o->plan, plan_bytes, &c->plan, &n, &c->context->diag))
        return ls_command_failed(c->context, LS_ERR_INVALID);
    o->shoot.shown = c->plan;
    o->shoot.shown_name = o->plan;
    return LS_EXIT_OK;
}

/* ---- the end ---- */

static int read_base(struct calibration *c)
{
    const char *path = c->options->base;
    LS_CLEANUP_FREE char *text = NULL;
    struct ls_diag inner = {0};
    size_t n = 0;
    if (!path)
        return LS_EXIT_OK;
    enum ls_err err = ls_command_read_file(path, base_bytes, &text, &n, &c->context->diag);
    if (!err && ls_calibration_parse(text, n, &c->base, &inner))
        err = ls_fail(&c->context->diag, LS_ERR_INVALID, "%.200s: %.300s", path, inner.text);
    return err ? ls_command_failed(c->context, err) : LS_EXIT_OK;
}

static int conclude(struct calibration *c)
{
    const struct ls_calibrate_measured measured = {
        .grey_take = c->takes[LS_OBJECT_GREY],
        .chrome_take = c->takes[LS_OBJECT_CHROME],
        .gloss_take = c->takes[LS_OBJECT_GLOSS],
        .grey = c->grey,
        .chrome = c->takes[LS_OBJECT_CHROME] ? &c->chrome : NULL,
        .gloss = c->takes[LS_OBJECT_GLOSS] ? &c->gloss : NULL,
    };
    const struct ls_calibration *base =
        c->base ? c->base : c->takes[LS_OBJECT_GREY]->document->calibration;
    struct ls_diag *diag = &c->context->diag;
    LS_CLEANUP_FREE char *text = NULL;
    enum ls_err err = ls_calibrate_result(&measured, base, &c->result, &c->remarks, diag);
    if (!err)
        err = ls_calibration_write(c->result, &text, diag);
    if (!err)
        err = ls_command_write_file(c->options->output, text, strlen(text), diag);
    if (err)
        return failed(c, err);
    if (c->context->json)
        ls_command_print_json(ls_calibrate_json(c->result, &c->remarks, c->options->output));
    else
        ls_calibrate_print(c->result, &c->remarks);
    return LS_EXIT_OK;
}

static void finish(struct calibration *c)
{
    for (int i = 0; i < LS_N_OBJECTS; i++)
        ls_calibrate_take_close(c->takes[i]);
    for (int i = 0; i < LS_CALIBRATION_MAX_CAMERAS; i++)
        ls_calibrate_take_close(c->grey_takes[i]);
    ls_grey_destroy(c->grey);
    ls_gloss_finish(&c->gloss);
    free(c->plan);
    ls_calibration_destroy(c->base);
    ls_calibration_destroy(c->result);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct ls_calibrate_options options;
    struct calibration c = {.context = context, .options = &options};
    int code = ls_calibrate_options_parse(context, argc, argv, &options);
    if (!code)
        code = read_base(&c);
    if (!code)
        code = read_plan(&c);
    if (!code && ls_command_check_writable(options.output, &context->diag))
        code = ls_command_failed(context, LS_ERR_INVALID);
    if (!code)
        code = ls_command_open(context);
    context->quiet = true;
    if (!code)
        code = run_objects(&c);
    if (!code)
        code = conclude(&c);
    finish(&c);
    return code;
}

const struct ls_command ls_command_calibrate = {
    "calibrate", "Measure the lights on a grey sphere, a chrome ball and a black glossy sphere",
    "--output FILE [--base FILE] [--plan FILE] [--radius M] [--reflectance R] [--camera N,...]\n"
    "         [--exposures US,US,...] [--grey-exposures ...] [--chrome-exposures ...]\n"
    "         [--gloss-exposures ...] [--darks N] [--segments G] [--no-chrome] [--no-gloss]\n"
    "         [--yes] [--json]\n"
    "   or: --output FILE --grey TAKE [--chrome TAKE] [--gloss TAKE] [--base FILE] ...\n"
    "\n"
    "Asks for each object in turn, photographs and measures it; --yes goes on without asking.\n"
    "With --plan the factors of that plan's patterns are measured too, at its levels. With --grey\n"
    "it measures takes that exist. Several cameras see more of the lights; what else a "
    "calibration\n"
    "holds is of the first. Camera constants, spectra, chart and camera matrix cannot be measured\n"
    "so: they come from --base, else from the calibration in the grey take.",
    run};
