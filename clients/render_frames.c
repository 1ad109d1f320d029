#include "clients/render_frames.h"

#include "clients/command.h"
#include "clients/kept_files.h"
#include "clients/numbered_name.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static bool take_number(const char **at, uint32_t *out)
{
    char *end;
    if (**at < '0' || **at > '9')
        return false;
    unsigned long n = strtoul(*at, &end, 10);
    *out = (uint32_t)n;
    *at = end;
    return n < 1000000000;
}

bool ls_frame_range_option(const char *text, struct ls_frame_range *out)
{
    *out = (struct ls_frame_range){.step = 1};
    if (!take_number(&text, &out->first))
        return false;
    out->last = out->first;
    if (*text == '-' && (text++, !take_number(&text, &out->last)))
        return false;
    if (*text == 'x' && (text++, !take_number(&text, &out->step)))
        return false;
    return !*text && out->last >= out->first && out->step > 0 &&
           (out->last - out->first) / out->step < LS_RENDER_MAX_FRAMES;
}

bool ls_turn_range_option(const char *text, double out[2])
{
    char *end;
    out[0] = strtod(text, &end);
    if (end == text || *end != ',')
        return false;
    text = end + 1;
    out[1] = strtod(text, &end);
    return end != text && !*end && isfinite(out[0]) && isfinite(out[1]);
}

static int check(const char *const *lights, uint32_t n, const struct ls_frame_range *range,
                 uint32_t n_frames, const char *output)
{
    if (n == 1 && ls_name_has_number(lights[0]) && !range->step)
        return ls_command_wrong("%s: a sequence; --frames FIRST-LAST says of which numbers",
                                lights[0]);
    if (n > 1 && range->step && n_frames != n)
        return ls_command_wrong("%u environments for the %u frames of --frames", n, n_frames);
    if (n_frames > 1 && !ls_name_has_number(output))
        return ls_command_wrong("--output %s for %u frames: expected a number in the name, as in "
                                "relit.%%04d.exr",
                                output, n_frames);
    return LS_EXIT_OK;
}

/* No frame takes the place of an environment, its own or another's. */
static int keep_lights(const struct ls_render_frames *frames)
{
    const char **lights = calloc(frames->n, sizeof *lights);
    struct ls_kept_files kept = {0};
    int code = LS_EXIT_OK;
    for (uint32_t k = 0; k < frames->n && lights; k++)
        lights[k] = frames->items[k].light;
    if (!lights || !ls_kept_files_init(&kept, lights, frames->n))
        code = (ls_command_wrong("out of memory"), LS_EXIT_INTERNAL);
    for (uint32_t k = 0; k < frames->n && !code; k++)
        code = ls_kept_files_check(&kept, "--output", frames->items[k].path);
    ls_kept_files_finish(&kept);
    free(lights);
    return code;
}

int ls_render_frames_make(const char *const *lights, uint32_t n, const struct ls_frame_range *range,
                          const double turn[2], const char *output, struct ls_render_frames *out)
{
    uint32_t n_frames = range->step ? (range->last - range->first) / range->step + 1 : n;
    int code = check(lights, n, range, n_frames, output);
    if (code)
        return code;
    out->items = calloc(n_frames, sizeof *out->items);
    for (uint32_t k = 0; k < n_frames && out->items; k++) {
        struct ls_render_frame *frame = &out->items[out->n++];
        frame->number = range->step ? range->first + k * range->step : k + 1;
        frame->turn_deg =
            n_frames > 1 ? turn[0] + (turn[1] - turn[0]) * k / (n_frames - 1) : turn[0];
        frame->light = ls_name_numbered(lights[n > 1 ? k : 0], frame->number);
        frame->path = ls_name_numbered(output, frame->number);
        if (!frame->light || !frame->path)
            break;
    }
    bool whole = out->items && out->n == n_frames && out->items[n_frames - 1].path;
    return whole ? keep_lights(out) : (ls_command_wrong("out of memory"), LS_EXIT_INTERNAL);
}

void ls_render_frames_finish(struct ls_render_frames *frames)
{
    for (uint32_t k = 0; k < frames->n; k++) {
        free(frames->items[k].light);
        free(frames->items[k].path);
    }
    free(frames->items);
    memset(frames, 0, sizeof *frames);
}
