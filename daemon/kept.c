#include "daemon/kept.h"

#include "core/crc32c.h"
#include "daemon/bracket.h"
#include "daemon/diskio.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_BYTES = 1 << 30 };

static enum ls_err read_file(const char *folder, uint32_t camera, uint32_t shot,
                             const struct ls_kept_shot *kept, uint8_t **bytes, size_t *n,
                             struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *path = NULL;
    if (asprintf(&path, "%s/cam%u/raw/%u-%u.raw", folder, camera, shot, kept->attempt) < 0)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_disk_read(AT_FDCWD, path, MOST_BYTES, bytes, n, diag);
    if (!err && ls_crc32c(0, *bytes, *n) != kept->raw_crc32c)
        return ls_fail(diag, LS_ERR_MISMATCH,
                       "%.300s is not what its ticket says: find out what is wrong with the disk, "
                       "then resume the take",
                       path);
    return err;
}

enum ls_err ls_kept_read(const char *folder, uint32_t camera, uint32_t shot,
                         const struct ls_kept_shot *kept, void *raw, size_t n_bytes,
                         struct ls_diag *diag)
{
    LS_CLEANUP_FREE uint8_t *bytes = NULL;
    size_t n = 0;
    enum ls_err err = read_file(folder, camera, shot, kept, &bytes, &n, diag);
    if (!err && n != n_bytes)
        err = ls_fail(diag, LS_ERR_MISMATCH, "the kept frame of shot %u has %zu bytes, not %zu",
                      shot, n, n_bytes);
    if (!err)
        memcpy(raw, bytes, n_bytes);
    return err;
}

/* A frame that cannot be read, for whatever reason, is shot again. */
static bool is_sound(const char *folder, uint32_t camera, uint32_t shot,
                     const struct ls_kept_shot *kept)
{
    LS_CLEANUP_FREE uint8_t *bytes = NULL;
    size_t n = 0;
    return !read_file(folder, camera, shot, kept, &bytes, &n, NULL);
}

static void check_of(const struct ls_takedir *take, const struct ls_plan_condition *c,
                     uint32_t camera, struct ls_kept_shot *out)
{
    uint32_t there = 0, shot = 0;
    for (uint32_t i = c->first_step; i < c->first_step + c->n_steps; i++) {
        shot = i * take->n_cameras + camera;
        out[shot].there = out[shot].there && is_sound(take->folder, camera, shot, &out[shot]);
        there += out[shot].there;
    }
    if (there == c->n_steps)
        out[shot].there = false;
}

enum ls_err ls_kept_find(const struct ls_takedir *take, const struct ls_plan *plan,
                         const uint8_t *done, struct ls_kept_shot *out, struct ls_diag *diag)
{
    if (take->n_shots != plan->n_steps * take->n_cameras)
        return ls_fail(diag, LS_ERR_MISMATCH, "the take has %u shots, its plan %u", take->n_shots,
                       plan->n_steps * take->n_cameras);
    for (size_t i = 0; i < take->n_tickets; i++) {
        const struct ls_ticket *t = &take->tickets[i];
        if (t->shot >= take->n_shots || t->status != LS_FRAME_OK)
            continue;
        uint32_t condition = plan->steps[t->shot / take->n_cameras].condition;
        if (!done[condition] && ls_bracket_keeps(plan, &plan->conditions[condition]))
            out[t->shot] =
                (struct ls_kept_shot){true, t->attempt, t->raw_crc32c, t->exposure_used_us};
    }
    for (uint32_t i = 0; i < plan->n_conditions; i++)
        for (uint32_t k = 0; k < take->n_cameras; k++)
            check_of(take, &plan->conditions[i], k, out);
    return LS_OK;
}
