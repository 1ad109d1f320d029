#include "clients/render_work.h"

#include "clients/environment_file.h"
#include "clients/picture_attrs.h"
#include "clients/region_option.h"
#include "clients/relight_request.h"
#include "clients/relit_space.h"
#include "clients/render_file.h"
#include "clients/render_recipe.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Some frames, of which those that are whole already are left out. */
struct batch {
    struct ls_render_work *work;
    struct ls_command_context *context;
    uint32_t n;
    const struct ls_render_frame *frames[LS_RENDER_BATCH];
    struct ls_light_weights weights[LS_RENDER_BATCH];
    char recipe[LS_RENDER_BATCH][LS_RECIPE_TEXT];
    struct ls_render_file *files[LS_RENDER_BATCH];
    uint32_t first; /* of those that are being asked for */
};

/* ---- the light of a frame ---- */

static enum ls_err solve(const struct ls_render_work *work, const struct ls_render_frame *frame,
                         struct ls_light_weights *out, struct ls_diag *diag)
{
    const struct ls_relight_options *options = &work->options->relight;
    const struct ls_environment_ball known = {work->document->calibration, options->profile};
    struct ls_light_options light = options->solve;
    struct ls_environment_file environment;
    light.turn_deg = frame->turn_deg;
    if (ls_environment_file_read(frame->light, options->space, &known, &environment, diag))
        return LS_ERR_INVALID;
    enum ls_err err = ls_light_weights_make(work->document, &environment, &light, out, diag);
    ls_environment_file_finish(&environment);
    return err;
}

static void count(struct ls_render_work *work, uint32_t made, uint32_t kept, uint32_t rows)
{
    pthread_mutex_lock(&work->lock);
    work->made += made;
    work->kept += kept;
    work->rows += rows;
    pthread_cond_signal(&work->changed);
    pthread_mutex_unlock(&work->lock);
}

/* Once for all frames. */
static void warn(struct ls_render_work *work, const struct ls_light_weights *weights)
{
    pthread_mutex_lock(&work->lock);
    bool first = !work->warned;
    work->warned = true;
    pthread_mutex_unlock(&work->lock);
    if (first && weights->warning)
        (void)ls_command_wrong("warning: %s", weights->warning);
    if (first && weights->left_out[0])
        (void)ls_command_wrong("warning: %s", weights->left_out);
    if (first && !work->options->relight.raw && !ls_relit_in_rec709(work->document, weights))
        (void)ls_command_wrong("warning: the take has no matrix M: the frames stay in the camera's "
                               "own colours");
}

/* Into the batch, unless it is there. */
static enum ls_err add_frame(struct batch *batch, const struct ls_render_frame *frame)
{
    struct ls_render_work *work = batch->work;
    struct ls_light_weights *weights = &batch->weights[batch->n];
    char *recipe = batch->recipe[batch->n];
    enum ls_err err = solve(work, frame, weights, &batch->context->diag);
    if (err)
        return err;
    warn(work, weights);
    ls_render_recipe(work->document, &work->options->relight, weights, recipe);
    if (!work->options->again && ls_render_file_is_whole(frame->path, recipe)) {
        ls_light_weights_finish(weights);
        memset(weights, 0, sizeof *weights);
        count(work, 0, 1, 0);
        return LS_OK;
    }
    batch->frames[batch->n++] = frame;
    return LS_OK;
}

/* ---- its file ---- */

static void describe(const struct batch *batch, uint32_t k, struct ls_exr_attrs *attrs)
{
    const struct ls_render_work *work = batch->work;
    const struct ls_relight_options *options = &work->options->relight;
    const struct ls_light_weights *weights = &batch->weights[k];
    const struct ls_render_frame *frame = batch->frames[k];
    const char *file = strrchr(frame->light, '/');
    bool rec709 =
        ls_relit_in_rec709(work->document, weights) && (!options->raw || weights->after_m);
    ls_picture_attrs_take(work->document, work->document->calibration != NULL, attrs);
    ls_exr_attrs_string(attrs, "lightstage/environment", file ? file + 1 : frame->light);
    ls_exr_attrs_string(attrs, "lightstage/units", rec709 ? "rec709-linear" : "camera-raw");
    ls_exr_attrs_string(attrs, "lightstage/model", lightstage_model_name(options->promotion.model));
    ls_exr_attrs_float(attrs, "lightstage/rotation", (float)frame->turn_deg);
    ls_exr_attrs_int(attrs, "lightstage/frame", (int32_t)frame->number);
    ls_exr_attrs_string(attrs, "lightstage/recipe", batch->recipe[k]);
    if (rec709)
        ls_picture_attrs_primaries(&ls_primaries_rec709, attrs);
}

static enum ls_err begin_file(struct batch *batch, uint32_t k, uint32_t width, uint32_t height,
                              struct ls_diag *diag)
{
    const struct ls_take_document *document = batch->work->document;
    const struct ls_relight_options *options = &batch->work->options->relight;
    const struct ls_picture_place place =
        ls_level_place(&options->region, options->level, document->width, document->height);
    struct ls_exr_attrs attrs = {0};
    describe(batch, k, &attrs);
    const struct ls_exr_rows_of of = {.width = width,
                                      .height = height,
                                      .n_channels = 3,
                                      .x = place.x,
                                      .y = place.y,
                                      .display_width = place.whole_width,
                                      .display_height = place.whole_height,
                                      .type = LS_EXR_FLOAT,
                                      .attrs = &attrs};
    enum ls_err err = ls_render_file_begin(batch->frames[k]->path, &of, &batch->files[k], diag);
    ls_exr_attrs_finish(&attrs);
    return err;
}

static enum ls_err take_rows(void *user, const struct ls_relit_rows *rows, struct ls_diag *diag)
{
    struct batch *batch = user;
    const struct ls_render_work *work = batch->work;
    uint32_t k = batch->first + rows->picture;
    size_t n = (size_t)rows->n_rows * rows->width;
    enum ls_err err = LS_OK;
    if (atomic_load(work->stop))
        return ls_fail(diag, LS_ERR_ABORTED, "interrupted");
    if (!batch->files[k])
        err = begin_file(batch, k, rows->width, rows->height, diag);
    if (!err && !work->options->relight.raw && ls_relit_needs_m(work->document, &batch->weights[k]))
        ls_relit_apply_m(work->document, rows->rgb, n, rows->rgb);
    if (!err)
        err = ls_render_file_add(batch->files[k], rows->rgb, rows->n_rows, diag);
    count(batch->work, 0, 0, rows->n_rows);
    return err;
}

static enum ls_err end_files(struct batch *batch, uint32_t n)
{
    enum ls_err err = LS_OK;
    for (uint32_t k = batch->first; k < batch->first + n && !err; k++) {
        err = ls_render_file_end(batch->files[k], &batch->context->diag);
        if (!err)
            count(batch->work, 1, 0, 0);
    }
    return err;
}

/* ---- batches ---- */

static int render(struct batch *batch)
{
    struct ls_render_work *work = batch->work;
    struct ls_relit result = {0};
    int code = LS_EXIT_OK;
    for (uint32_t n = 0; batch->first < batch->n && !code; batch->first += n) {
        const struct ls_light_weights *weights = batch->weights + batch->first;
        n = ls_relight_at_once(&work->options->relight, work->document, weights,
                               batch->n - batch->first);
        code = ls_relight_request(batch->context, &work->options->relight, work->document, weights,
                                  n, take_rows, batch, &result);
        if (!code && end_files(batch, n))
            code = ls_command_failed(batch->context, LS_ERR_INVALID);
    }
    return code;
}

/* Frames from @first on; 0, or the exit code. */
static int make_batch(struct ls_render_worker *worker, uint32_t first, uint32_t n)
{
    struct batch batch = {.work = worker->work, .context = &worker->context};
    enum ls_err err = LS_OK;
    for (uint32_t k = first; k < first + n && !err && !atomic_load(worker->work->stop); k++)
        err = add_frame(&batch, &worker->work->options->frames.items[k]);
    int code = err ? ls_command_failed(&worker->context, err) : render(&batch);
    for (uint32_t k = 0; k < LS_RENDER_BATCH; k++) {
        ls_light_weights_finish(&batch.weights[k]);
        ls_render_file_destroy(batch.files[k]);
    }
    return code;
}

/* As many for each worker, but not more than a batch. */
static uint32_t take_some(struct ls_render_work *work, uint32_t *first)
{
    uint32_t jobs = work->options->jobs;
    pthread_mutex_lock(&work->lock);
    uint32_t left = work->options->frames.n - work->next, n = (left + jobs - 1) / jobs;
    n = n < LS_RENDER_BATCH ? n : LS_RENDER_BATCH;
    n = work->code || atomic_load(work->stop) ? 0 : n;
    *first = work->next;
    work->next += n;
    pthread_mutex_unlock(&work->lock);
    return n;
}

void *ls_render_worker_run(void *data)
{
    struct ls_render_worker *worker = data;
    struct ls_render_work *work = worker->work;
    int code = LS_EXIT_OK;
    for (uint32_t first, n; !code && (n = take_some(work, &first)) > 0;)
        code = make_batch(worker, first, n);
    pthread_mutex_lock(&work->lock);
    work->code = work->code ? work->code : code;
    work->running--;
    pthread_cond_signal(&work->changed);
    pthread_mutex_unlock(&work->lock);
    return NULL;
}
