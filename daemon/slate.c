#include "daemon/slate.h"

#include "daemon/diskio.h"

#include <errno.h>
#include <fcntl.h>
#include <glib.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

enum { FORMAT = 1, MAX_BYTES = 64 * 1024 };
static const char file_name[] = "slate.json", damaged_name[] = "slate.damaged.json";

static bool is_text(const char *text, bool lines)
{
    if (!g_utf8_validate(text, -1, NULL))
        return false;
    for (; *text; text = g_utf8_next_char(text))
        if (g_unichar_iscntrl(g_utf8_get_char(text)) && !(lines && *text == '\n'))
            return false;
    return true;
}

static bool is_timecode(const char *text)
{
    unsigned h, m, s, f;
    char separator;
    int n = 0;
    return sscanf(text, "%2u:%2u:%2u%c%2u%n", &h, &m, &s, &separator, &f, &n) == 5 && n == 11 &&
           !text[n] && strspn(text, "0123456789:;") == 11 && h < 24 && m < 60 && s < 60 &&
           (separator == ':' || separator == ';');
}

enum ls_err ls_slate_check(const struct ls_slate *slate, struct ls_diag *diag)
{
    if (!is_text(slate->slate, false) || !is_text(slate->scene, false) ||
        !is_text(slate->notes, true))
        return ls_fail(diag, LS_ERR_INVALID,
                       "slate: expected UTF-8 text without control characters");
    if (slate->take > LS_SLATE_MAX_TAKE)
        return ls_fail(diag, LS_ERR_INVALID, "slate: take %u: expected 1..%u, or 0 for none",
                       slate->take, LS_SLATE_MAX_TAKE);
    if (slate->timecode[0] && !is_timecode(slate->timecode))
        return ls_fail(diag, LS_ERR_INVALID,
                       "slate: timecode \"%.16s\": expected HH:MM:SS:FF, or HH:MM:SS;FF",
                       slate->timecode);
    return LS_OK;
}

static enum ls_err open_folder(const char *folder, int *fd, struct ls_diag *diag)
{
    *fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (*fd < 0)
        return ls_fail(diag, errno == ENOENT || errno == ENOTDIR ? LS_ERR_NOT_FOUND : LS_ERR_OS,
                       "%s: %s", folder, strerror(errno));
    return LS_OK;
}

static bool copy(const json_t *root, const char *key, char *out, size_t size)
{
    const char *text = json_string_value(json_object_get(root, key));
    return text && g_strlcpy(out, text, size) < size;
}

static bool decode(const json_t *root, struct ls_slate *slate)
{
    const json_t *take = json_object_get(root, "take"), *circled = json_object_get(root, "circled");
    json_int_t number = json_integer_value(take);
    slate->take = (uint32_t)number;
    slate->circled = json_is_true(circled);
    return json_integer_value(json_object_get(root, "format")) == FORMAT &&
           copy(root, "slate", slate->slate, sizeof slate->slate) &&
           copy(root, "scene", slate->scene, sizeof slate->scene) &&
           copy(root, "timecode", slate->timecode, sizeof slate->timecode) &&
           copy(root, "notes", slate->notes, sizeof slate->notes) && json_is_integer(take) &&
           number >= 0 && number <= LS_SLATE_MAX_TAKE && json_is_boolean(circled) &&
           ls_slate_check(slate, NULL) == LS_OK;
}

/* LS_ERR_INVALID: damaged. All zero on every error, and where there is none. */
static enum ls_err load(int fd, const char *folder, struct ls_slate *slate, struct ls_diag *diag)
{
    uint8_t *bytes = NULL;
    size_t n;
    *slate = (struct ls_slate){.take = 0};
    enum ls_err err = ls_disk_read(fd, file_name, MAX_BYTES, &bytes, &n, diag);
    if (err == LS_ERR_NOT_FOUND)
        return LS_OK;
    if (err && err != LS_ERR_LIMIT)
        return err;
    json_t *root = err ? NULL : json_loadb((const char *)bytes, n, JSON_REJECT_DUPLICATES, NULL);
    bool good = root && decode(root, slate);
    json_decref(root);
    free(bytes);
    if (good)
        return LS_OK;
    *slate = (struct ls_slate){.take = 0};
    return ls_fail(diag, LS_ERR_INVALID,
                   "%s/%s is damaged: what is written down next replaces it, the take itself does "
                   "not need it",
                   folder, file_name);
}

enum ls_err ls_slate_read(const char *folder, struct ls_slate *slate, struct ls_diag *diag)
{
    int fd;
    *slate = (struct ls_slate){.take = 0};
    enum ls_err err = open_folder(folder, &fd, diag);
    if (err)
        return err;
    err = load(fd, folder, slate, diag);
    close(fd);
    return err;
}

static char *encode(const struct ls_slate *slate)
{
    json_t *root = json_pack("{si ss ss si sb ss ss}", "format", FORMAT, "slate", slate->slate,
                             "scene", slate->scene, "take", (int)slate->take, "circled",
                             slate->circled, "timecode", slate->timecode, "notes", slate->notes);
    char *text = root ? json_dumps(root, JSON_INDENT(2)) : NULL;
    json_decref(root);
    return text;
}

static enum ls_err store(int fd, const char *folder, const struct ls_slate *slate,
                         struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *text = encode(slate);
    if (!text)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_disk_replace(NULL, fd, file_name, text, strlen(text), NULL, diag);
    return err ? err : ls_disk_sync_dir(NULL, fd, folder, diag);
}

static void merge(struct ls_slate *now, unsigned fields, const struct ls_slate *change)
{
    if (fields & LS_SLATE_SLATE)
        memcpy(now->slate, change->slate, sizeof now->slate);
    if (fields & LS_SLATE_SCENE)
        memcpy(now->scene, change->scene, sizeof now->scene);
    if (fields & LS_SLATE_TAKE)
        now->take = change->take;
    if (fields & LS_SLATE_CIRCLED)
        now->circled = change->circled;
    if (fields & LS_SLATE_TIMECODE)
        memcpy(now->timecode, change->timecode, sizeof now->timecode);
    if (fields & LS_SLATE_NOTES)
        memcpy(now->notes, change->notes, sizeof now->notes);
}

/* Under the folder's lock. */
static enum ls_err change(int fd, const char *folder, unsigned fields, struct ls_slate *slate,
                          bool *damaged, struct ls_diag *diag)
{
    struct ls_slate now;
    enum ls_err err = load(fd, folder, &now, diag);
    *damaged = err == LS_ERR_INVALID;
    if (err && !*damaged)
        return err;
    if (*damaged && renameat(fd, file_name, fd, damaged_name))
        return ls_fail(diag, LS_ERR_OS, "%s/%s: %s", folder, damaged_name, strerror(errno));
    merge(&now, fields, slate);
    err = store(fd, folder, &now, diag);
    if (!err)
        *slate = now;
    return err;
}

enum ls_err ls_slate_change(const char *folder, unsigned fields, struct ls_slate *slate,
                            bool *damaged, struct ls_diag *diag)
{
    int fd;
    *damaged = false;
    enum ls_err err = ls_slate_check(slate, diag);
    if (!err)
        err = open_folder(folder, &fd, diag);
    if (err)
        return err;
    if (flock(fd, LOCK_EX)) /* released with the descriptor */
        err = ls_fail(diag, LS_ERR_OS, "%s: %s", folder, strerror(errno));
    else
        err = change(fd, folder, fields, slate, damaged, diag);
    close(fd);
    return err;
}
