#include "clients/calibrate_grey.h"
#include "clients/calibrate_probe.h"
#include "clients/calibrate_report.h"
#include "clients/calibrate_shoot.h"
#include "clients/calibrate_take.h"
#include "clients/command.h"
#include "clients/region_option.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const size_t base_bytes = (size_t)256 << 20, plan_bytes = (size_t)1 << 20;

struct options {
    const char *output, *base, *plan;
    const char *takes[LS_N_OBJECTS]; /* existing ones; NULL = to be made */
    bool skip[LS_N_OBJECTS];
    double radius_m, reflectance;
    uint32_t cameras[LS_CALIBRATION_MAX_CAMERAS], n_cameras;
    struct ls_calibrate_shoot shoot;
};

/* The takes and what they said. */
struct calibration {
    struct ls_command_context *context;
    struct options *options;
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

/* ---- options ---- */

enum {
    OUTPUT = 1,
    BASE,
    PLAN,
    GREY,
    CHROME,
    GLOSS,
    NO_CHROME,
    NO_GLOSS,
    RADIUS,
    REFLECTANCE,
    CAMERA,
    SEGMENTS,
    DARKS,
    YES,
    EXPOSURES,
    GREY_EXPOSURES,
    CHROME_EXPOSURES,
    GLOSS_EXPOSURES,
};

static bool number(const char *text, double low, double high, double *out)
{
    char *end;
    *out = strtod(text, &end);
    return end != text && !*end && *out >= low && *out <= high;
}

static bool whole(const char *text, uint32_t low, uint32_t high, uint32_t *out)
{
    double value;
    bool ok = number(text, low, high, &value);
    *out = ok ? (uint32_t)value : 0;
    return ok && *out == value;
}

/* Digits, commas and spaces: the rest is the daemon's to judge. */
static bool exposures(const char *text, const char **out)
{
    *out = text;
    return text[0] && strlen(text) < 256 && strspn(text, "0123456789, ") == strlen(text);
}

static bool camera_list(const char *text, struct options *o)
{
    LS_CLEANUP_FREE uint32_t *list = NULL;
    size_t n = 0;
    if (!ls_lights_option(text, LS_CALIBRATION_MAX_CAMERAS, &list, &n))
        return false;
    memcpy(o->cameras, list, n * sizeof *list);
    o->n_cameras = (uint32_t)n;
    return true;
}

static int parse_number(struct options *o, int option)
{
    if (option == RADIUS && !number(optarg, 0.001, 10, &o->radius_m))
        return ls_command_wrong("--radius %s: expected metres, 0.001 to 10", optarg);
    if (option == REFLECTANCE && !number(optarg, 0.01, 1, &o->reflectance))
        return ls_command_wrong("--reflectance %s: expected 0.01 to 1", optarg);
    if (option == CAMERA && !camera_list(optarg, o))
        return ls_command_wrong("--camera %s: expected a camera's number, from 0, or several: 0,1",
                                optarg);
    o->shoot.segments_asked |= option == SEGMENTS;
    if (option == SEGMENTS && !whole(optarg, 0, 4096, &o->shoot.segments))
        return ls_command_wrong("--segments %s: expected 0 to 4096", optarg);
    if (option == DARKS && !whole(optarg, 2, 4096, &o->shoot.darks))
        return ls_command_wrong("--darks %s: expected 2 to 4096", optarg);
    return LS_EXIT_OK;
}

static int parse_option(struct options *o, int option)
{
    switch (option) {
    case OUTPUT:
        o->output = optarg;
        return LS_EXIT_OK;
    case BASE:
        o->base = optarg;
        return LS_EXIT_OK;
    case PLAN:
        o->plan = optarg;
        return LS_EXIT_OK;
    case GREY:
    case CHROME:
    case GLOSS:
        o->takes[option - GREY] = optarg;
        return LS_EXIT_OK;
    case NO_CHROME:
        o->skip[LS_OBJECT_CHROME] = true;
        return LS_EXIT_OK;
    case NO_GLOSS:
        o->skip[LS_OBJECT_GLOSS] = true;
        return LS_EXIT_OK;
    case YES:
        o->shoot.yes = true;
        return LS_EXIT_OK;
    case EXPOSURES:
    case GREY_EXPOSURES:
    case CHROME_EXPOSURES:
    case GLOSS_EXPOSURES:
        for (int i = 0; i < LS_N_OBJECTS; i++)
            if ((option == EXPOSURES || option == GREY_EXPOSURES + i) &&
                !exposures(optarg, &o->shoot.exposures_us[i]))
                return ls_command_wrong(
                    "%s: expected microseconds, shortest first, e.g. 100,800,6400", optarg);
        return LS_EXIT_OK;
    default:
        return option == '?' ? LS_EXIT_USAGE : parse_number(o, option);
    }
}

static int parse(struct ls_command_context *context, int argc, char **argv, struct options *o)
{
    static const struct option options[] = {
        {"output", required_argument, NULL, OUTPUT},
        {"base", required_argument, NULL, BASE},
        {"plan", required_argument, NULL, PLAN},
        {"grey", required_argument, NULL, GREY},
        {"chrome", required_argument, NULL, CHROME},
        {"gloss", required_argument, NULL, GLOSS},
        {"no-chrome", no_argument, NULL, NO_CHROME},
        {"no-gloss", no_argument, NULL, NO_GLOSS},
        {"radius", required_argument, NULL, RADIUS},
        {"reflectance", required_argument, NULL, REFLECTANCE},
        {"camera", required_argument, NULL, CAMERA},
        {"segments", required_argument, NULL, SEGMENTS},
        {"darks", required_argument, NULL, DARKS},
        {"yes", no_argument, NULL, YES},
        {"exposures", required_argument, NULL, EXPOSURES},
        {"grey-exposures", required_argument, NULL, GREY_EXPOSURES},
        {"chrome-exposures", required_argument, NULL, CHROME_EXPOSURES},
        {"gloss-exposures", required_argument, NULL, GLOSS_EXPOSURES},
        LS_COMMON_OPTIONS};
    for (int option;
         (option = ls_command_option(context, &ls_command_calibrate, argc, argv, options)) != -1;) {
        int code = parse_option(o, option);
        if (code)
            return code;
    }
    if (!ls_command_arguments(&ls_command_calibrate, argc, 0))
        return LS_EXIT_USAGE;
    if (!o->output)
        return ls_command_wrong("calibrate: --output FILE is needed");
    for (int i = 0; i < LS_N_OBJECTS; i++)
        if (o->skip[i] && o->takes[i])
            return ls_command_wrong("calibrate: --no-chrome and --no-gloss leave out what --chrome "
                                    "and --gloss name: give one of them");
    if (o->plan && o->takes[LS_OBJECT_GREY])
        return ls_command_wrong(
            "calibrate: --plan says what to photograph, and --grey names a take "
            "that was: give one of them");
    if (!o->takes[LS_OBJECT_GREY] && (o->takes[LS_OBJECT_CHROME] || o->takes[LS_OBJECT_GLOSS]))
        return ls_command_wrong(
            "calibrate: --chrome and --gloss name takes that go with --grey TAKE");
    return LS_EXIT_OK;
}

/* ---- steps ---- */

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
    struct options *o = c->options;
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
    const struct options *o = c->options;
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
    struct options *o = c->options;
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
    static const char usual[] = "100, 800, 6400";
    struct options options = {.radius_m = 0.1,
                              .reflectance = 0.33,
                              .n_cameras = 1,
                              .shoot = {{usual, usual, usual}, .darks = 16, .segments = 14}};
    struct calibration c = {.context = context, .options = &options};
    int code = parse(context, argc, argv, &options);
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
