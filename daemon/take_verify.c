#include "daemon/takedir.h"

#include "core/crc32c.h"
#include "daemon/take_links.h"
#include "daemon/tilesum.h"

#include <fcntl.h>
#include <glib.h>
#include <stdlib.h>
#include <string.h>

static const size_t picture_limit_bytes = (size_t)4 << 30;
static const size_t raw_limit_bytes = (size_t)1 << 30;

/* Halves 0 to 3, which is all a validity plane holds; anything else stays different. */
static uint8_t validity_of(uint16_t half)
{
    switch (half) {
    case 0x0000:
        return 0;
    case 0x3c00:
        return 1;
    case 0x4000:
        return 2;
    case 0x4200:
        return 3;
    default:
        return 255;
    }
}

static enum ls_err read_validity(const void *bytes, size_t n_bytes,
                                 const struct ls_exr_plane *plane, uint8_t **validity,
                                 struct ls_diag *diag)
{
    struct ls_exr_plane flags;
    *validity = NULL;
    enum ls_err err =
        ls_exr_read_plane(bytes, n_bytes, "validity", picture_limit_bytes, &flags, diag);
    if (err)
        return err == LS_ERR_NOT_FOUND ? LS_OK : err;
    size_t n = (size_t)flags.width * flags.height;
    if (flags.type != LS_EXR_HALF || flags.width != plane->width || flags.height != plane->height)
        err = ls_fail(diag, LS_ERR_MISMATCH, "its validity part has another size or type");
    else if (!(*validity = malloc(n)))
        err = ls_fail(diag, LS_ERR_NOMEM, "no memory for %zu bytes", n);
    for (size_t k = 0; !err && k < n; k++)
        (*validity)[k] = validity_of(((const uint16_t *)flags.samples)[k]);
    free(flags.samples);
    return err;
}

static enum ls_err compare(const struct ls_published *want, const struct ls_published *got,
                           struct ls_diag *diag)
{
    if (got->width != want->width || got->height != want->height || got->is_float != want->is_float)
        return ls_fail(diag, LS_ERR_MISMATCH, "%s: %u x %u %s: the journal says %u x %u %s",
                       want->file, got->width, got->height, got->is_float ? "float" : "half",
                       want->width, want->height, want->is_float ? "float" : "half");
    for (uint32_t k = 0; k < want->n_tiles; k++) {
        uint32_t invalid = got->tile_invalid ? got->tile_invalid[k] : 0;
        uint32_t expected = want->tile_invalid ? want->tile_invalid[k] : 0;
        if (got->tile_crc[k] != want->tile_crc[k] || got->tile_max[k] != want->tile_max[k] ||
            invalid != expected)
            return ls_fail(diag, LS_ERR_MISMATCH, "%s: tile %u of %u is not what was published",
                           want->file, k, want->n_tiles);
    }
    if (want->tile_invalid && got->validity_crc != want->validity_crc)
        return ls_fail(diag, LS_ERR_MISMATCH, "%s: the validity part is not what was published",
                       want->file);
    return LS_OK;
}

enum ls_err ls_published_check(const struct ls_published *published, const void *bytes,
                               size_t n_bytes, struct ls_diag *diag)
{
    struct ls_exr_plane plane;
    struct ls_published got = {0};
    struct ls_diag why = {0};
    uint8_t *validity = NULL;
    enum ls_err err = ls_exr_read_plane(bytes, n_bytes, NULL, picture_limit_bytes, &plane, &why);
    if (err)
        return ls_fail(diag, err, "%s: %s", published->file, why.text);
    err = read_validity(bytes, n_bytes, &plane, &validity, &why);
    if (err) {
        ls_fail(diag, err, "%s: %s", published->file, why.text);
    } else {
        struct ls_exr_mosaic mosaic = {
            .width = plane.width, .height = plane.height, .validity = validity};
        if (plane.type == LS_EXR_HALF)
            mosaic.half = plane.samples;
        else
            mosaic.floats = plane.samples;
        err = ls_tilesum(&mosaic, &got);
        err = err ? ls_fail(diag, err, "%s: no memory", published->file)
                  : compare(published, &got, diag);
    }
    ls_published_finish(&got);
    free(validity);
    free(plane.samples);
    return err;
}

static void verify_picture(const struct ls_takedir *take, const char *condition, uint32_t camera,
                           struct ls_take_report *report, GString *text)
{
    const struct ls_published *published = ls_takedir_find(take, condition, camera);
    struct ls_diag diag = {0};
    uint8_t *bytes = NULL;
    size_t n;
    if (!published) {
        report->pictures_missing++;
        g_string_append_printf(text, "cam%u/%s is missing: it was never published\n", camera,
                               condition);
        return;
    }
    enum ls_err err = ls_takedir_read(take, published, &bytes, &n, &diag);
    if (!err)
        err = ls_published_check(published, bytes, n, &diag);
    if (err) {
        report->pictures_damaged++;
        g_string_append_printf(text, "cam%u/%s is damaged: %s\n", camera, condition, diag.text);
    } else {
        report->pictures_good++;
    }
    free(bytes);
}

/* One flag per planned shot: has it a good ticket? */
static uint8_t *ticketed(const struct ls_takedir *take)
{
    uint8_t *have = g_new0(uint8_t, take->n_shots + 1);
    for (size_t k = 0; k < take->n_tickets; k++)
        if (take->tickets[k].shot < take->n_shots && take->tickets[k].status == LS_FRAME_OK)
            have[take->tickets[k].shot] = 1;
    return have;
}

static void verify_tickets(const struct ls_takedir *take, const uint8_t *have,
                           struct ls_take_report *report, GString *text)
{
    GString *ranges = g_string_new(NULL);
    for (uint32_t shot = 0; shot < take->n_shots; shot++) {
        report->shots_ticketed += have[shot];
        if (have[shot] || (shot && !have[shot - 1]))
            continue;
        uint32_t last = shot;
        while (last + 1 < take->n_shots && !have[last + 1])
            last++;
        g_string_append_printf(ranges, last > shot ? "%s%u-%u" : "%s%u", ranges->len ? ", " : "",
                               shot, last);
    }
    if (ranges->len)
        g_string_append_printf(text, "%u of %u shots have no ticket: %s\n",
                               take->n_shots - report->shots_ticketed, take->n_shots, ranges->str);
    g_string_free(ranges, TRUE);
}

static void verify_raw(const struct ls_takedir *take, const struct ls_ticket *ticket, GString *text)
{
    char *path = g_strdup_printf("%s/cam%u/raw/%u-%u.raw", take->folder, ticket->camera,
                                 ticket->shot, ticket->attempt);
    struct ls_diag diag = {0};
    uint8_t *bytes = NULL;
    size_t n;
    if (ls_disk_read(AT_FDCWD, path, raw_limit_bytes, &bytes, &n, &diag))
        g_string_append_printf(text, "the raw frame of shot %u cannot be read: %s\n", ticket->shot,
                               diag.text);
    else if (n != ticket->raw_bytes || ls_crc32c(0, bytes, n) != ticket->raw_crc32c)
        g_string_append_printf(text, "the raw frame of shot %u is not what its ticket says: %s\n",
                               ticket->shot, path);
    free(bytes);
    g_free(path);
}

enum ls_err ls_takedir_verify(const struct ls_takedir *take, struct ls_take_report *report,
                              struct ls_diag *diag)
{
    GString *text = g_string_new(NULL);
    uint8_t *have = ticketed(take);
    *report = (struct ls_take_report){.shots_planned = take->n_shots,
                                      .pictures_planned = take->n_conditions * take->n_cameras};
    verify_tickets(take, have, report, text);
    ls_take_check_links(take, text);
    for (uint32_t k = 0; k < take->n_conditions; k++)
        for (uint32_t camera = 0; camera < take->n_cameras; camera++)
            verify_picture(take, take->conditions[k], camera, report, text);
    for (size_t k = take->n_tickets; take->keep_raw && k-- > 0;) {
        const struct ls_ticket *ticket = &take->tickets[k];
        if (ticket->status != LS_FRAME_OK || ticket->shot >= take->n_shots || !have[ticket->shot])
            continue;
        have[ticket->shot] = 0; /* the last good attempt only */
        verify_raw(take, ticket, text);
    }
    if (take->torn_bytes)
        g_string_append_printf(text,
                               "the journal ends in %zu bytes of a torn record, which do not "
                               "count\n",
                               take->torn_bytes);
    g_free(have);
    report->text = g_string_free(text, FALSE);
    return LS_OK;
}

void ls_take_report_finish(struct ls_take_report *report)
{
    g_free(report->text);
    *report = (struct ls_take_report){0};
}
