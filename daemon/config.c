#include "daemon/config.h"

#include "core/positions.h"
#include "daemon/conf_read.h"
#include "daemon/file.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { POSITIONS_MAX_BYTES = 4 << 20, SPECTRA_MAX_BYTES = 4 << 20 };

static const char *const channel_kinds[] = {"spectrum", "polariser", NULL};
/* What a Timed camera starts with; a take writes every step's own. */
#define TIMED_US 1000.0

static const char *const unit_words[] = {"m", "cm", "mm", NULL};
static const char *const trigger_words[] = {"line", "software", NULL};
static const char *const exposure_words[] = {"width", "timed", "auto", NULL};

/* The column named like the channel, or the only one. */
static void read_spectrum(struct ls_conf *c, const char *path, struct ls_config_channel *out)
{
    LS_CLEANUP_FREE char *text = NULL;
    struct ls_spectra *spectra = NULL;
    size_t length = 0;
    struct ls_diag why = {0};
    c->err = ls_file_read(path, SPECTRA_MAX_BYTES, &text, &length, c->diag);
    if (c->err)
        return;
    if (ls_spectra_parse_csv(text, length, &spectra, &why)) {
        ls_conf_error(c, "spectrum", "%s: %.300s", path, why.text);
        return;
    }
    const struct ls_spectrum *found = ls_spectra_find(spectra, out->name);
    if (!found && spectra->n == 1)
        found = &spectra->item[0].spectrum;
    if (!found)
        ls_conf_error(c, "spectrum", "%s: no column is named %s", path, out->name);
    else if (!(out->spectrum = malloc(sizeof *out->spectrum)))
        c->err = ls_fail(c->diag, LS_ERR_NOMEM, "out of memory");
    else
        *out->spectrum = *found;
    ls_spectra_destroy(spectra);
}

static void read_channel(struct ls_conf *list, const config_setting_t *group,
                         struct ls_config_channel *out)
{
    struct ls_conf c;
    ls_conf_begin(&c, group, list->file, list->diag);
    out->name = ls_conf_need_string(&c, "name");
    out->polariser = ls_conf_word(&c, "kind", channel_kinds, 0) == 1;
    LS_CLEANUP_FREE char *path = ls_conf_beside(list->file, ls_conf_string(&c, "spectrum", NULL));
    if (path && out->name)
        read_spectrum(&c, path, out);
    if (out->name &&
        (!*out->name || strlen(out->name) > 8 ||
         strspn(out->name, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789") !=
             strlen(out->name)))
        ls_conf_error(&c, "name", "\"%s\": expected 1 to 8 letters or digits", out->name);
    list->err = list->err ? list->err : ls_conf_finish(&c);
}

static void read_channels(struct ls_conf *rig, struct ls_config *config)
{
    const config_setting_t *list = ls_conf_child(rig, "channels", CONFIG_TYPE_LIST, true);
    int n = list ? config_setting_length(list) : 0;
    if (list && (n < 1 || n > LS_MAX_CHANNELS)) {
        ls_conf_error(rig, "channels", "%d channels: expected 1 to %d", n, LS_MAX_CHANNELS);
        return;
    }
    for (int i = 0; i < n && !rig->err; i++) {
        config->n_channels = (uint32_t)i + 1;
        read_channel(rig, config_setting_get_elem(list, (unsigned)i), &config->channels[i]);
        for (int j = 0; j < i && !rig->err; j++)
            if (!strcmp(config->channels[i].name, config->channels[j].name))
                ls_conf_error(rig, "channels", "name \"%s\" appears twice",
                              config->channels[i].name);
    }
}

static void to_floats(const double *in, float *out, unsigned n)
{
    for (unsigned i = 0; i < n; i++)
        out[i] = (float)in[i];
}

static void read_camera_driver(struct ls_conf *c, struct ls_camera_config *d)
{
    d->driver = ls_conf_string(c, "driver", "aravis");
    d->address = ls_conf_need_string(c, "address");
    d->width = (uint32_t)ls_conf_int(c, "width", 0, 0, 65535);
    d->height = (uint32_t)ls_conf_int(c, "height", 0, 0, 65535);
    d->offset_x = (uint32_t)ls_conf_int(c, "offset_x", 0, 0, 65535);
    d->offset_y = (uint32_t)ls_conf_int(c, "offset_y", 0, 0, 65535);
    d->pixel_format = ls_conf_need_string(c, "pixel_format");
    d->packet_size = (uint32_t)ls_conf_int(c, "packet_size", 9000, 576, 65000);
    d->frame_retention_us = (uint32_t)ls_conf_int(c, "frame_retention_us", 200000, 1000, 10000000);
    d->gain = ls_conf_number(c, "gain", 0, 0, 1000);
    d->chunks = ls_conf_bool(c, "chunks", true);
    d->trigger =
        ls_conf_word(c, "trigger", trigger_words, 0) ? LS_TRIGGER_SOFTWARE : LS_TRIGGER_LINE;
    d->exposure =
        (enum ls_camera_exposure)ls_conf_word(c, "exposure", exposure_words, LS_EXPOSURE_AUTO);
    d->exposure_us = TIMED_US;
    d->rt_priority = (int)ls_conf_int(c, "rt_priority", 20, 0, 98);
    if (d->trigger == LS_TRIGGER_SOFTWARE && d->exposure == LS_EXPOSURE_WIDTH)
        ls_conf_error(c, "exposure",
                      "\"width\" needs trigger = \"line\": a software trigger has "
                      "no width; use exposure = \"timed\"");
}

static void read_camera(struct ls_conf *list, const config_setting_t *group,
                        struct ls_config_camera *out)
{
    struct ls_conf c;
    ls_conf_begin(&c, group, list->file, list->diag);
    double v[3];
    out->name = ls_conf_string(&c, "name", "camera");
    read_camera_driver(&c, &out->driver);
    if (ls_conf_numbers(&c, "position_m", v, 3, true))
        to_floats(v, out->position_m, 3);
    if (ls_conf_numbers(&c, "look_at_m", v, 3, true))
        to_floats(v, out->look_at_m, 3);
    out->focal_length_mm = (float)ls_conf_need_number(&c, "focal_length_mm", 1, 2000);
    out->lens = ls_conf_string(&c, "lens", NULL);
    out->aperture = ls_conf_number(&c, "aperture", 0, 0, 1000);
    out->iso_speed = ls_conf_number(&c, "iso_speed", 0, 0, 1e7);
    if (ls_conf_numbers(&c, "sensor_mm", v, 2, true)) {
        out->sensor_width_mm = (float)v[0];
        out->sensor_height_mm = (float)v[1];
    }
    if (ls_conf_numbers(&c, "range", v, 2, true)) {
        out->range_low = (float)v[0];
        out->range_high = (float)v[1];
        if (!(v[0] >= 0 && v[0] < v[1] && v[1] <= 1))
            ls_conf_error(&c, "range", "[%g, %g]: expected 0 <= low < high <= 1", v[0], v[1]);
    }
    out->black_dn = ls_conf_need_number(&c, "black_dn", 0, 65535);
    out->full_scale_dn = ls_conf_need_number(&c, "full_scale_dn", 1, 65535);
    out->electrons_per_dn = ls_conf_number(&c, "electrons_per_dn", 1, 1e-6, 1e6);
    out->read_noise_dn = ls_conf_number(&c, "read_noise_dn", 1, 0, 65535);
    out->measure_offset = !config_setting_get_member(group, "exposure_offset_us");
    out->exposure_offset_us = ls_conf_number(&c, "exposure_offset_us", 0, -1000, 1000);
    out->max_fps = ls_conf_need_number(&c, "max_fps", 0.01, 100000);
    out->black_check = ls_conf_bool(&c, "black_check", true);
    list->err = list->err ? list->err : ls_conf_finish(&c);
}

static void read_cameras(struct ls_conf *rig, struct ls_config *config)
{
    const config_setting_t *list = ls_conf_child(rig, "cameras", CONFIG_TYPE_LIST, true);
    int n = list ? config_setting_length(list) : 0;
    if (list && (n < 1 || n > LS_MAX_CAMERAS)) {
        ls_conf_error(rig, "cameras", "%d cameras: expected 1 to %d", n, LS_MAX_CAMERAS);
        return;
    }
    for (int i = 0; i < n && !rig->err; i++) {
        config->n_cameras = (uint32_t)i + 1;
        read_camera(rig, config_setting_get_elem(list, (unsigned)i), &config->cameras[i]);
    }
}

/* Cameras that send at the same time each leave room for the others' packets between two of
 * theirs. */
static void share_link(struct ls_config *config)
{
    for (uint32_t i = 0; config->link_mbit_s > 0 && i < config->n_cameras; i++) {
        struct ls_camera_config *d = &config->cameras[i].driver;
        double packet_ns = d->packet_size * 8e3 / config->link_mbit_s;
        d->packet_delay_ns = (uint32_t)ceil((config->n_cameras - 1) * packet_ns);
    }
}

static void read_lights(struct ls_conf *rig, struct ls_config *config)
{
    struct ls_conf c;
    const config_setting_t *group = ls_conf_child(rig, "lights", CONFIG_TYPE_GROUP, true);
    if (rig->err)
        return;
    ls_conf_begin(&c, group, rig->file, rig->diag);
    LS_CLEANUP_FREE char *path = ls_conf_beside(rig->file, ls_conf_need_string(&c, "positions"));
    LS_CLEANUP_FREE char *axes = ls_conf_string(&c, "axes", "right,up,towards");
    const char *unit = unit_words[ls_conf_word(&c, "unit", unit_words, 0)];
    struct ls_positions positions = {0};
    LS_CLEANUP_FREE char *text = NULL;
    size_t length = 0;
    if (!c.err)
        c.err = ls_file_read(path, POSITIONS_MAX_BYTES, &text, &length, c.diag);
    if (!c.err)
        c.err =
            ls_positions_parse(text, length, path, axes, unit, LS_MAX_LIGHTS, &positions, c.diag);
    if (c.err == LS_ERR_INVALID && c.diag && !strncmp(c.diag->text, "axes ", 5)) {
        struct ls_diag said = *c.diag;
        c.err = LS_OK;
        ls_conf_error(&c, "axes", "%s", said.text + 5);
    }
    rig->err = ls_conf_finish(&c);
    if (!rig->err)
        config->lights = calloc(positions.n, sizeof *config->lights);
    for (uint32_t i = 0; config->lights && i < positions.n; i++) {
        memcpy(config->lights[i].position_m, positions.xyz_m[i], sizeof positions.xyz_m[i]);
        config->lights[i].address = positions.address[i];
    }
    config->n_lights = config->lights ? positions.n : 0;
    ls_positions_finish(&positions);
}

/* libconfig does not say, and does not always leave errno behind. */
static const char *why_unreadable(const char *path)
{
    char byte;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0)
        return strerror(errno);
    const char *why = read(fd, &byte, 1) < 0 ? strerror(errno) : "not a text file";
    close(fd);
    return why;
}

static void read_rig(struct ls_config *config, const char *path, struct ls_conf *daemon)
{
    config_t tree;
    struct ls_conf rig;
    config_init(&tree);
    if (!config_read_file(&tree, path)) {
        daemon->err = config_error_line(&tree)
                          ? ls_fail(daemon->diag, LS_ERR_INVALID, "%s:%d: %s", path,
                                    config_error_line(&tree), config_error_text(&tree))
                          : ls_fail(daemon->diag, LS_ERR_NOT_FOUND,
                                    "%s: cannot read the rig file named by key rig in %s: %s", path,
                                    daemon->file, why_unreadable(path));
        config_destroy(&tree);
        return;
    }
    ls_conf_begin(&rig, config_root_setting(&tree), path, daemon->diag);
    config->rig_name = ls_conf_string(&rig, "name", "rig");
    read_lights(&rig, config);
    read_channels(&rig, config);
    read_cameras(&rig, config);
    config->link_mbit_s = ls_conf_number(&rig, "link_mbit_s", 0, 1, 1e6);
    share_link(config);
    daemon->err = ls_conf_finish(&rig);
    config_destroy(&tree);
}

static void read_controller(struct ls_conf *daemon, struct ls_lights_config *out)
{
    struct ls_conf c;
    const config_setting_t *group = ls_conf_child(daemon, "controller", CONFIG_TYPE_GROUP, true);
    if (daemon->err)
        return;
    ls_conf_begin(&c, group, daemon->file, daemon->diag);
    out->driver = ls_conf_string(&c, "driver", "modbus");
    out->address = ls_conf_need_string(&c, "address");
    out->port = (unsigned)ls_conf_int(&c, "port", 502, 1, 65535);
    out->baud = (unsigned)ls_conf_int(&c, "baud", 115200, 1200, 4000000);
    out->unit = (unsigned)ls_conf_int(&c, "unit", 1, 0, 255);
    out->timeout_ms = (unsigned)ls_conf_int(&c, "timeout_ms", 500, 10, 60000);
    daemon->err = ls_conf_finish(&c);
}

/* After the rig, whose channels it names. */
static void read_work_light(struct ls_conf *daemon, struct ls_config *config)
{
    struct ls_conf c;
    const config_setting_t *group = ls_conf_child(daemon, "work_light", CONFIG_TYPE_GROUP, false);
    if (!group || daemon->err)
        return;
    ls_conf_begin(&c, group, daemon->file, daemon->diag);
    LS_CLEANUP_FREE char *name = ls_conf_need_string(&c, "channel");
    config->work_level = (uint16_t)ls_conf_int(&c, "level", 0, 1, 65535);
    int channel = name ? ls_config_channel(config, name) : 0;
    if (channel < 0)
        ls_conf_error(&c, "channel", "\"%s\": the rig has no such channel", name);
    if (!c.err && !config->work_level)
        ls_conf_error(&c, "level", "expected 1 to 65535");
    config->work_channel = (uint16_t)(channel < 0 ? 0 : channel);
    daemon->err = ls_conf_finish(&c);
}

static void read_daemon(struct ls_conf *c, struct ls_config *config, const char *path)
{
    config->storage = ls_conf_beside(path, ls_conf_need_string(c, "storage"));
    config->socket_path = ls_conf_beside(path, ls_conf_need_string(c, "socket"));
    config->reserve_bytes =
        (uint64_t)ls_conf_int(c, "reserve_bytes", 64 << 20, 0, INT64_C(1) << 50);
    config->max_connections = (uint32_t)ls_conf_int(c, "max_connections", 128, 1, 4096);
    config->max_connections_each = (uint32_t)ls_conf_int(c, "max_connections_each", 64, 1, 4096);
    config->idle_s = (uint32_t)ls_conf_int(c, "idle_s", 900, 1, 604800);
    ls_conf_access(c, &config->access);
    ls_conf_listen(c, &config->listen, &config->access);
}

/* What takes are made with. */
static void read_stage(struct ls_conf *c, struct ls_config *config, const char *path)
{
    long cpus = sysconf(_SC_NPROCESSORS_ONLN);
    config->calibration_path = ls_conf_beside(path, ls_conf_string(c, "calibration", NULL));
    config->merge_threads = (uint32_t)ls_conf_int(c, "merge_threads",
                                                  cpus < 1   ? 1
                                                  : cpus > 8 ? 8
                                                             : cpus,
                                                  1, 64);
    config->ring_slots = (uint32_t)ls_conf_int(c, "ring_slots", 32, 16, 1024);
    config->retries = (uint32_t)ls_conf_int(c, "retries", 3, 0, 100);
    config->queue_bytes =
        (uint64_t)ls_conf_int(c, "queue_bytes", 256 << 20, 1 << 20, INT64_C(1) << 40);
    read_controller(c, &config->lights_driver);
    LS_CLEANUP_FREE char *rig = ls_conf_beside(path, ls_conf_need_string(c, "rig"));
    if (!c->err)
        read_rig(config, rig, c);
    if (!c->err)
        read_work_light(c, config);
}

/* Where nothing is said of a stage there is none. */
static bool has_stage(const config_t *tree)
{
    static const char *const keys[] = {"rig",        "controller", "calibration", "merge_threads",
                                       "ring_slots", "retries",    "queue_bytes", "work_light"};
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (config_lookup(tree, keys[i]))
            return true;
    return false;
}

enum ls_err ls_config_load(const char *path, struct ls_config **out, struct ls_diag *diag)
{
    config_t tree;
    struct ls_conf c;
    struct ls_config *config = calloc(1, sizeof *config);
    if (!config)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    config_init(&tree);
    enum ls_err err;
    if (!config_read_file(&tree, path)) {
        err = config_error_line(&tree)
                  ? ls_fail(diag, LS_ERR_INVALID, "%s:%d: %s", path, config_error_line(&tree),
                            config_error_text(&tree))
                  : ls_fail(diag, LS_ERR_NOT_FOUND, "%s: cannot read the configuration file: %s",
                            path, why_unreadable(path));
    } else {
        ls_conf_begin(&c, config_root_setting(&tree), path, diag);
        read_daemon(&c, config, path);
        if (has_stage(&tree))
            read_stage(&c, config, path);
        err = ls_conf_finish(&c);
    }
    config_destroy(&tree);
    if (err) {
        ls_config_destroy(config);
        return err;
    }
    *out = config;
    return LS_OK;
}

void ls_config_destroy(struct ls_config *config)
{
    if (!config)
        return;
    for (uint32_t i = 0; i < config->n_channels; i++) {
        free(config->channels[i].name);
        free(config->channels[i].spectrum);
    }
    for (uint32_t i = 0; i < config->n_cameras; i++) {
        free(config->cameras[i].name);
        free(config->cameras[i].lens);
        free((char *)config->cameras[i].driver.driver);
        free((char *)config->cameras[i].driver.address);
        free((char *)config->cameras[i].driver.pixel_format);
    }
    free((char *)config->lights_driver.driver);
    free((char *)config->lights_driver.address);
    free(config->lights);
    free(config->rig_name);
    ls_access_finish(&config->access);
    ls_listen_config_finish(&config->listen);
    free(config->storage);
    free(config->socket_path);
    free(config->calibration_path);
    free(config);
}

int ls_config_channel(const struct ls_config *config, const char *name)
{
    for (uint32_t i = 0; i < config->n_channels; i++)
        if (!strcmp(config->channels[i].name, name))
            return (int)i;
    return -1;
}
