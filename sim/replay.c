#include "core/png.h"
#include "sim/file.h"
#include "sim/world.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_FILE_BYTES = 256 << 20 };

static int is_png(const struct dirent *entry)
{
    size_t n = strlen(entry->d_name);
    return n > 4 && !strcasecmp(entry->d_name + n - 4, ".png");
}

/* Luminance of linear Rec. 709, top left in a row-major picture @width wide; white is a 90 %
 * diffuser facing a light. */
static void to_radiance(const struct ls_image *image, float *out, uint32_t width)
{
    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++) {
            size_t at = (size_t)y * image->width + x;
            const float *p = image->pixels + at * image->n_channels;
            float value =
                image->n_channels == 1 ? p[0] : 0.2126f * p[0] + 0.7152f * p[1] + 0.0722f * p[2];
            out[(size_t)y * width + x] = value * (float)(0.9 / M_PI);
        }
}

static enum ls_err load_image(struct sim_scene *scene, const char *name, uint32_t light,
                              struct ls_diag *diag)
{
    char path[1400];
    snprintf(path, sizeof path, "%s/%s", scene->config.replay_dir, name);
    LS_CLEANUP_FREE char *bytes = NULL;
    size_t size = 0;
    struct ls_image image = {0};
    struct ls_diag inner = {{0}};
    enum ls_err err = sim_file_read(path, MAX_FILE_BYTES, &bytes, &size, diag);
    if (err)
        return err;
    err = ls_png_read(bytes, size, !scene->config.replay_linear, MAX_FILE_BYTES, &image, &inner);
    if (err)
        return ls_fail(diag, err, "%s: %.400s", path, inner.text);
    const struct sim_view *view = &scene->view[0];
    if (image.width > view->width || image.height > view->height)
        err = ls_fail(diag, LS_ERR_INVALID, "%s: has %u x %u px, the camera only %u x %u", path,
                      image.width, image.height, view->width, view->height);
    else
        to_radiance(&image, scene->replay + (size_t)light * view->width * view->height,
                    view->width);
    ls_image_finish(&image);
    return err;
}

static enum ls_err check(const struct sim_scene *scene, int found, struct ls_diag *diag)
{
    if (scene->config.n_cameras != 1 || scene->colours[0] != 1 || scene->config.n_channels != 1)
        return ls_fail(diag, LS_ERR_INVALID, "replay: expected one mono camera and one channel");
    if (found < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "%s: %s", scene->config.replay_dir, strerror(errno));
    if ((uint32_t)found < scene->geometry.n_lights)
        return ls_fail(diag, LS_ERR_INVALID, "%s: holds %d PNG images for %u lights",
                       scene->config.replay_dir, found, scene->geometry.n_lights);
    return LS_OK;
}

enum ls_err sim_replay_load(struct sim_scene *scene, struct ls_diag *diag)
{
    struct dirent **names = NULL;
    int found = scandir(scene->config.replay_dir, &names, is_png, alphasort);
    enum ls_err err = check(scene, found, diag);
    size_t pixels = (size_t)scene->view[0].width * scene->view[0].height;
    if (!err && !(scene->replay = calloc(pixels * scene->geometry.n_lights, sizeof(float))))
        err = ls_fail(diag, LS_ERR_NOMEM, "out of memory for the images of %u lights",
                      scene->geometry.n_lights);
    for (uint32_t i = 0; i < scene->geometry.n_lights && !err; i++)
        err = load_image(scene, names[i]->d_name, i, diag);
    for (int i = 0; i < found; i++)
        free(names[i]);
    free(names);
    return err;
}
