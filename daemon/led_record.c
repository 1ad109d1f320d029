#include "daemon/led_record.h"

#include "daemon/diskio.h"
#include "daemon/file.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { FORMAT = 1, MAX_BYTES = 16 << 20, NAMED = 8 };

static const char name[] = "leds.json";

static enum ls_err put_in_place(const char *storage, const char *text, struct ls_diag *diag)
{
    int folder = open(storage, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder < 0)
        return ls_fail(diag, LS_ERR_OS, "storage folder %s: %s", storage, strerror(errno));
    enum ls_err err = ls_disk_replace(NULL, folder, name, text, strlen(text), NULL, diag);
    if (!err)
        err = ls_disk_sync_dir(NULL, folder, storage, diag);
    close(folder);
    return err;
}

enum ls_err ls_led_record_write(const char *storage, const char *take, const json_t *checks,
                                struct ls_diag *diag)
{
    const json_t *leds = json_object_get(checks, "leds");
    json_t *record = json_pack("{si ss sO sO}", "format", FORMAT, "take", take, "dead",
                               json_object_get(leds, "dead"), "dim", json_object_get(leds, "dim"));
    LS_CLEANUP_FREE char *text = record ? json_dumps(record, JSON_COMPACT) : NULL;
    json_decref(record);
    return text ? put_in_place(storage, text, diag)
                : ls_fail(diag, LS_ERR_NOMEM, "out of memory writing %s", name);
}

static bool is_record(const json_t *record)
{
    return json_integer_value(json_object_get(record, "format")) == FORMAT &&
           json_is_string(json_object_get(record, "take")) &&
           json_is_array(json_object_get(record, "dead")) &&
           json_is_array(json_object_get(record, "dim"));
}

enum ls_err ls_led_record_read(const char *storage, json_t **record, struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *path = NULL;
    LS_CLEANUP_FREE char *text = NULL;
    size_t length;
    *record = NULL;
    if (asprintf(&path, "%s/%s", storage, name) < 0)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_file_read(path, MAX_BYTES, &text, &length, diag);
    if (err)
        return err == LS_ERR_NOT_FOUND ? LS_OK : err;
    *record = json_loads(text, JSON_REJECT_DUPLICATES, NULL);
    if (is_record(*record))
        return LS_OK;
    json_decref(*record);
    *record = NULL;
    return ls_fail(diag, LS_ERR_INVALID, "%s does not say what a sweep found: sweep again", path);
}

static void say(const json_t *leds, const char *what, char *text, size_t room)
{
    size_t n = json_array_size(leds), used = strlen(text);
    if (n)
        snprintf(text + used, room - used, "%s%zu LEDs %s:", used ? "; " : "", n, what);
    for (size_t i = 0; i < n && i <= NAMED; i++) {
        const json_t *led = json_array_get(leds, i);
        const char *channel = json_string_value(json_object_get(led, "channel"));
        used = strlen(text);
        if (i == NAMED)
            snprintf(text + used, room - used, " ...");
        else
            snprintf(text + used, room - used, " %s-%04" JSON_INTEGER_FORMAT,
                     channel ? channel : "?", json_integer_value(json_object_get(led, "light")));
    }
}

void ls_led_record_say(const json_t *record, char *text, size_t room)
{
    text[0] = 0;
    say(json_object_get(record, "dead"), "give no light", text, room);
    say(json_object_get(record, "dim"), "are dim", text, room);
    size_t used = strlen(text);
    if (used)
        snprintf(text + used, room - used, " (sweep %s)",
                 json_string_value(json_object_get(record, "take")));
}
