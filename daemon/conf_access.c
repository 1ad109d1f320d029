#include "daemon/conf_access.h"

#include <stdlib.h>
#include <string.h>

/* The longest common name X.509 allows (RFC 5280, ub-common-name). */
enum { NAME_MAX_CHARACTERS = 64 };

/* An array of one type, NULL if absent. */
static const config_setting_t *array(struct ls_conf *c, const char *key, int *n)
{
    const config_setting_t *list = ls_conf_child(c, key, CONFIG_TYPE_ARRAY, false);
    *n = list ? config_setting_length(list) : 0;
    if (*n > LS_ACCESS_MAX) {
        ls_conf_error(c, key, "%d entries: expected at most %d", *n, LS_ACCESS_MAX);
        *n = 0;
    }
    return list;
}

static void read_ids(struct ls_conf *c, const char *key, struct ls_access_ids *out)
{
    int n;
    const config_setting_t *list = array(c, key, &n);
    for (int i = 0; i < n && !c->err; i++) {
        const config_setting_t *item = config_setting_get_elem(list, (unsigned)i);
        long long id = config_setting_get_int64(item);
        bool number = config_setting_type(item) == CONFIG_TYPE_INT ||
                      config_setting_type(item) == CONFIG_TYPE_INT64;
        if (!number || id < 0 || id >= UINT32_MAX)
            ls_conf_error(c, key, "expected numbers of users or groups, as in [1000, 1001]");
        else
            out->id[out->n++] = (unsigned)id;
    }
}

static void read_names(struct ls_conf *c, const char *key, struct ls_access_names *out)
{
    int n;
    const config_setting_t *list = array(c, key, &n);
    for (int i = 0; i < n && !c->err; i++) {
        const char *name = config_setting_get_string_elem(list, i);
        if (!name || !name[0] || strlen(name) > NAME_MAX_CHARACTERS)
            ls_conf_error(c, key, "expected common names, 1 to %d characters, as in [\"node-1\"]",
                          NAME_MAX_CHARACTERS);
        else if (!(out->name[out->n++] = strdup(name)))
            c->err = ls_fail(c->diag, LS_ERR_NOMEM, "out of memory");
    }
}

void ls_conf_access(struct ls_conf *daemon, struct ls_access *access)
{
    struct ls_conf c;
    const config_setting_t *group = ls_conf_child(daemon, "access", CONFIG_TYPE_GROUP, false);
    if (!group || daemon->err)
        return;
    ls_conf_begin(&c, group, daemon->file, daemon->diag);
    access->listed = true;
    read_ids(&c, "operator_uids", &access->operator_uids);
    read_ids(&c, "operator_gids", &access->operator_gids);
    read_ids(&c, "reader_uids", &access->reader_uids);
    read_ids(&c, "reader_gids", &access->reader_gids);
    daemon->err = ls_conf_finish(&c);
}

void ls_conf_listen(struct ls_conf *daemon, struct ls_listen_config *out, struct ls_access *access)
{
    struct ls_conf c;
    const config_setting_t *group = ls_conf_child(daemon, "listen", CONFIG_TYPE_GROUP, false);
    if (!group || daemon->err)
        return;
    ls_conf_begin(&c, group, daemon->file, daemon->diag);
    out->address = ls_conf_string(&c, "address", "127.0.0.1");
    out->port = (unsigned)ls_conf_int(&c, "port", 7472, 0, 65535);
    out->certificate = ls_conf_beside(c.file, ls_conf_need_string(&c, "certificate"));
    out->key = ls_conf_beside(c.file, ls_conf_need_string(&c, "key"));
    out->authority = ls_conf_beside(c.file, ls_conf_need_string(&c, "authority"));
    read_names(&c, "operators", &access->operators);
    read_names(&c, "readers", &access->readers);
    daemon->err = ls_conf_finish(&c);
}

void ls_listen_config_finish(struct ls_listen_config *config)
{
    free(config->address);
    free(config->certificate);
    free(config->key);
    free(config->authority);
    memset(config, 0, sizeof *config);
}
