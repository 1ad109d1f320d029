#include "daemon/take_token.h"

#include "daemon/diskio.h"
#include "daemon/take_head.h"
#include "daemon/takedir.h"

#include <fcntl.h>
#include <glib.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const size_t limit_bytes = (size_t)512 << 20;

static gint newest_first(gconstpointer a, gconstpointer b)
{
    return strcmp(*(const char *const *)b, *(const char *const *)a);
}

/* Ids begin with their time. */
static GPtrArray *takes_of(const char *storage, const char *name)
{
    GPtrArray *ids = g_ptr_array_new_with_free_func(g_free);
    char *part = g_strdup_printf("-%s-", name);
    GDir *folder = g_dir_open(storage, 0, NULL);
    const char *id;
    while (folder && (id = g_dir_read_name(folder)))
        if (ls_takedir_id_ok(id) && strstr(id, part))
            g_ptr_array_add(ids, g_strdup(id));
    if (folder)
        g_dir_close(folder);
    g_free(part);
    g_ptr_array_sort(ids, newest_first);
    return ids;
}

static bool is_of(const char *take_json, size_t n, const char *token)
{
    json_t *document = json_loadb(take_json, n, 0, NULL);
    const char *said = json_string_value(json_object_get(document, "token"));
    bool same = said && !strcmp(said, token);
    json_decref(document);
    return same;
}

static void describe(const char *id, const char *token, enum ls_store_state state,
                     struct ls_take_status *status)
{
    static const enum ls_take_state states[] = {[LS_STORE_OPEN] = LS_TAKE_FAILED,
                                                [LS_STORE_COMPLETE] = LS_TAKE_COMPLETE,
                                                [LS_STORE_INCOMPLETE] = LS_TAKE_INCOMPLETE,
                                                [LS_STORE_ABORTED] = LS_TAKE_ABORTED,
                                                [LS_STORE_FAILED] = LS_TAKE_FAILED};
    *status = (struct ls_take_status){.state = states[state]};
    g_strlcpy(status->id, id, sizeof status->id);
    g_strlcpy(status->token, token, sizeof status->token);
    snprintf(status->message, sizeof status->message, "%s before the daemon was started again%s",
             state == LS_STORE_OPEN ? "cut off" : ls_store_state_name(state),
             state == LS_STORE_COMPLETE ? "" : ": resume the take");
}

static bool look(const char *storage, const char *id, const char *token,
                 struct ls_take_status *status)
{
    char *path = g_build_filename(storage, id, "take.json", NULL);
    struct ls_take_head head;
    uint8_t *text = NULL;
    size_t n = 0;
    bool found = ls_disk_read(AT_FDCWD, path, limit_bytes, &text, &n, NULL) == LS_OK &&
                 is_of((const char *)text, n, token) &&
                 ls_take_head_parse((const char *)text, n, &head, NULL) == LS_OK;
    if (found) {
        describe(id, token, head.state, status);
        ls_take_head_finish(&head);
    }
    free(text);
    g_free(path);
    return found;
}

bool ls_take_token_find(const char *storage, const char *name, const char *token,
                        struct ls_take_status *status)
{
    bool found = false;
    if (!*token)
        return false;
    GPtrArray *ids = takes_of(storage, name);
    for (guint i = 0; i < ids->len && i < LS_TOKEN_TAKES && !found; i++)
        found = look(storage, ids->pdata[i], token, status);
    g_ptr_array_free(ids, TRUE);
    return found;
}
