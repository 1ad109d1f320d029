/*
 * config: the daemon's file, the rig's, the positions' and a spectrum, one after the other with
 * NULs between them. What loads is within the ranges that config.h and daemon/README.md promise.
 */
#include "daemon/config.h"
#include "tests/fuzz/fuzz.h"

#include <math.h>
#include <string.h>

/* libconfig loses strings that it cannot place (daemon/conf_text.h): once for each start of a
 * daemon with a configuration that is refused. */
const char *__lsan_default_suppressions(void);
const char *__lsan_default_suppressions(void)
{
    return "leak:libconfig.so";
}

static int finite_vector(const float v[3])
{
    return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]);
}

static void check_camera(const struct ls_config_camera *c)
{
    HOLDS(c->name && c->driver.driver && c->driver.address && c->driver.pixel_format);
    HOLDS(finite_vector(c->position_m) && finite_vector(c->look_at_m));
    HOLDS(c->sensor_width_mm > 0 && isfinite(c->sensor_width_mm));
    HOLDS(c->sensor_height_mm > 0 && isfinite(c->sensor_height_mm));
    HOLDS(c->focal_length_mm >= 1 && c->full_scale_dn >= 1 && c->max_fps > 0);
    HOLDS(c->range_low >= 0 && c->range_low <= c->range_high && c->range_high <= 1);
}

static void check(const struct ls_config *config)
{
    HOLDS(config->storage && config->socket_path);
    if (!config->rig_name) { /* it serves takes and makes none */
        HOLDS(config->n_lights + config->n_channels + config->n_cameras == 0);
        return;
    }
    HOLDS(config->n_lights >= 1 && config->n_lights <= LS_MAX_LIGHTS);
    HOLDS(config->n_channels >= 1 && config->n_channels <= LS_MAX_CHANNELS);
    HOLDS(config->n_cameras >= 1 && config->n_cameras <= LS_MAX_CAMERAS);
    HOLDS(config->merge_threads >= 1 && config->merge_threads <= 64);
    HOLDS(config->ring_slots >= 16 && config->ring_slots <= 1024);
    HOLDS(config->work_channel < config->n_channels);
    for (uint32_t i = 0; i < config->n_lights; i++)
        HOLDS(finite_vector(config->lights[i].position_m));
    for (uint32_t i = 0; i < config->n_channels; i++)
        HOLDS(ls_config_channel(config, config->channels[i].name) == (int)i);
    for (uint32_t i = 0; i < config->n_cameras; i++)
        check_camera(&config->cameras[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    static const char *const names[] = {"daemon.conf", "rig.conf", "positions.csv", "spectrum.csv"};
    struct ls_config *config = NULL;
    struct ls_diag diag = {0};
    char path[128];
    /* an included file could be any of this machine's */
    if (memmem(data, n, "@include", 8))
        return 0;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const uint8_t *end = n ? memchr(data, 0, n) : NULL;
        size_t some = end ? (size_t)(end - data) : n;
        fuzz_file(names[i], data, some);
        data += end ? some + 1 : some;
        n -= end ? some + 1 : some;
    }
    snprintf(path, sizeof path, "%s/daemon.conf", fuzz_folder());
    enum ls_err err = ls_config_load(path, &config, &diag);
    HOLDS_REFUSED(err, diag);
    HOLDS(!err == !!config);
    if (config)
        check(config);
    ls_config_destroy(config);
    return 0;
}
