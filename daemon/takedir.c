#include "daemon/takedir.h"

#include "daemon/take_head.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <glib.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const size_t take_json_limit_bytes = (size_t)256 << 20;
static const size_t journal_limit_bytes = (size_t)4 << 30;
static const size_t picture_limit_bytes = (size_t)1 << 30;

bool ls_takedir_name_ok(const char *name, size_t max_length)
{
    size_t n = strspn(name, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-");
    return n >= 1 && n <= max_length && !name[n];
}

bool ls_takedir_id_ok(const char *id)
{
    static const char stamp[] = "dddddddd"
                                "T"
                                "dddddd"
                                "Z-"; /* d = digit */
    size_t n = strlen(id), head = sizeof stamp - 1;
    if (n < head + 1 + 7 || n > head + 64 + 7 || !ls_takedir_name_ok(id, n))
        return false;
    for (size_t k = 0; k < head; k++)
        if (stamp[k] == 'd' ? !g_ascii_isdigit(id[k]) : id[k] != stamp[k])
            return false;
    return id[n - 7] == '-' && strspn(id + n - 6, "0123456789abcdef") == 6;
}

/* ---- list ---- */

static void summarize(int root_fd, const char *id, struct ls_take_summary *summary)
{
    char *file = g_build_filename(id, "take.json", NULL);
    struct ls_take_head head;
    struct ls_diag diag = {0};
    uint8_t *text = NULL;
    size_t n;
    *summary = (struct ls_take_summary){.state = LS_STORE_FAILED};
    g_strlcpy(summary->id, id, sizeof summary->id);
    enum ls_err err = ls_disk_read(root_fd, file, take_json_limit_bytes, &text, &n, &diag);
    if (!err)
        err = ls_take_head_parse((char *)text, n, &head, &diag);
    if (err) {
        g_strlcpy(summary->damage, diag.text, sizeof summary->damage);
    } else {
        summary->state = head.state;
        summary->shots_planned = head.n_shots;
        summary->conditions_planned = head.n_conditions * head.n_cameras;
        strcpy(summary->name, head.name);
        ls_take_head_finish(&head);
    }
    free(text);
    g_free(file);
}

static int by_id(const void *a, const void *b)
{
    const struct ls_take_summary *left = a, *right = b;
    return strcmp(left->id, right->id);
}

enum ls_err ls_takedir_list(const char *root, struct ls_take_summary **takes, size_t *n,
                            struct ls_diag *diag)
{
    DIR *dir = opendir(root);
    size_t capacity = 0;
    *takes = NULL;
    *n = 0;
    if (!dir)
        return ls_fail(diag, errno == ENOENT || errno == ENOTDIR ? LS_ERR_NOT_FOUND : LS_ERR_OS,
                       "cannot list takes in %s: %m", root);
    for (struct dirent *entry; (entry = readdir(dir));) {
        if (!ls_takedir_id_ok(entry->d_name))
            continue;
        if (*n == capacity) {
            capacity = capacity ? 2 * capacity : 16;
            struct ls_take_summary *grown = realloc(*takes, capacity * sizeof *grown);
            if (!grown) {
                free(*takes);
                *takes = NULL;
                closedir(dir);
                return ls_fail(diag, LS_ERR_NOMEM, "no memory to list takes");
            }
            *takes = grown;
        }
        summarize(dirfd(dir), entry->d_name, &(*takes)[(*n)++]);
    }
    closedir(dir);
    if (*n)
        qsort(*takes, *n, sizeof **takes, by_id);
    return LS_OK;
}

/* ---- open ---- */

/* Growing arrays while the journal is replayed. */
struct loader {
    GArray *tickets, *published;
    GPtrArray *alarms;
};

static enum ls_err load_ticket(void *user, const struct ls_ticket *ticket)
{
    struct loader *loader = user;
    g_array_append_val(loader->tickets, *ticket);
    return LS_OK;
}

static uint32_t *copy_u32(const uint32_t *values, size_t n)
{
    return values ? g_memdup2(values, n * sizeof *values) : NULL;
}

static enum ls_err load_published(void *user, const struct ls_published *published)
{
    struct loader *loader = user;
    struct ls_published copy = *published;
    copy.tile_crc = copy_u32(published->tile_crc, published->n_tiles);
    copy.tile_max = copy_u32(published->tile_max, published->n_tiles);
    copy.tile_invalid = copy_u32(published->tile_invalid, published->n_tiles);
    g_array_append_val(loader->published, copy);
    return LS_OK;
}

static enum ls_err load_alarm(void *user, const char *text)
{
    struct loader *loader = user;
    g_ptr_array_add(loader->alarms, g_strdup(text));
    return LS_OK;
}

static enum ls_err load_journal(int dir_fd, struct ls_takedir *take, struct ls_diag *diag)
{
    uint8_t *text;
    size_t n;
    enum ls_err err = ls_disk_read(dir_fd, "journal", journal_limit_bytes, &text, &n, diag);
    if (err)
        return err;
    struct loader loader = {g_array_new(FALSE, FALSE, sizeof(struct ls_ticket)),
                            g_array_new(FALSE, FALSE, sizeof(struct ls_published)),
                            g_ptr_array_new()};
    const struct ls_journal_reader reader = {&loader, load_ticket, load_published, load_alarm,
                                             NULL};
    err = ls_journal_replay((char *)text, n, &reader, &take->journal_good_bytes, diag);
    take->torn_bytes = n - take->journal_good_bytes;
    take->n_tickets = loader.tickets->len;
    take->n_published = loader.published->len;
    take->n_alarms = loader.alarms->len;
    take->tickets = (struct ls_ticket *)g_array_free(loader.tickets, FALSE);
    take->published = (struct ls_published *)g_array_free(loader.published, FALSE);
    take->alarms = (char **)g_ptr_array_free(loader.alarms, FALSE);
    free(text);
    return err;
}

static enum ls_err load_head(int dir_fd, struct ls_takedir *take, struct ls_diag *diag)
{
    struct ls_take_head head;
    uint8_t *text;
    size_t n;
    enum ls_err err = ls_disk_read(dir_fd, "take.json", take_json_limit_bytes, &text, &n, diag);
    if (err)
        return err;
    take->take_json = (char *)text;
    err = ls_take_head_parse((char *)text, n, &head, diag);
    if (err)
        return err;
    take->state = head.state;
    take->n_cameras = head.n_cameras;
    take->n_shots = head.n_shots;
    take->keep_raw = head.keep_raw;
    take->conditions = head.conditions; /* stolen */
    take->n_conditions = head.n_conditions;
    strcpy(take->name, head.name);
    return LS_OK;
}

enum ls_err ls_takedir_open(const char *folder, struct ls_takedir **out, struct ls_diag *diag)
{
    *out = NULL;
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return ls_fail(diag, errno == ENOENT || errno == ENOTDIR ? LS_ERR_NOT_FOUND : LS_ERR_OS,
                       "cannot open the take %s: %m", folder);
    struct ls_takedir *take = g_new0(struct ls_takedir, 1);
    char *id = g_path_get_basename(folder);
    take->folder = g_strdup(folder);
    g_strlcpy(take->id, id, sizeof take->id);
    g_free(id);
    enum ls_err err = load_head(fd, take, diag);
    if (!err)
        err = load_journal(fd, take, diag);
    close(fd);
    if (err) {
        ls_takedir_close(take);
        return err;
    }
    *out = take;
    return LS_OK;
}

void ls_takedir_close(struct ls_takedir *take)
{
    if (!take)
        return;
    for (uint32_t k = 0; take->conditions && k < take->n_conditions; k++)
        free(take->conditions[k]);
    for (size_t k = 0; k < take->n_published; k++)
        ls_published_finish(&take->published[k]);
    for (size_t k = 0; k < take->n_alarms; k++)
        g_free(take->alarms[k]);
    free(take->conditions);
    g_free(take->published);
    g_free(take->alarms);
    g_free(take->tickets);
    free(take->take_json);
    g_free(take->folder);
    g_free(take);
}

const struct ls_published *ls_takedir_find(const struct ls_takedir *take, const char *condition,
                                           uint32_t camera)
{
    for (size_t k = take->n_published; k-- > 0;)
        if (take->published[k].camera == camera && !strcmp(take->published[k].condition, condition))
            return &take->published[k];
    return NULL;
}

const struct ls_ticket *ls_takedir_ticket(const struct ls_takedir *take, uint32_t shot)
{
    for (size_t k = take->n_tickets; k-- > 0;)
        if (take->tickets[k].shot == shot && take->tickets[k].status == LS_FRAME_OK)
            return &take->tickets[k];
    return NULL;
}

enum ls_err ls_takedir_read(const struct ls_takedir *take, const struct ls_published *published,
                            uint8_t **bytes, size_t *n_bytes, struct ls_diag *diag)
{
    char *path = g_build_filename(take->folder, published->file, NULL);
    enum ls_err err = ls_disk_read(AT_FDCWD, path, picture_limit_bytes, bytes, n_bytes, diag);
    g_free(path);
    return err;
}
