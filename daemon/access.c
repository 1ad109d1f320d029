#include "daemon/access.h"

#include <stdlib.h>
#include <string.h>

const char *ls_role_name(enum ls_role role)
{
    static const char *const names[] = {"nobody", "reader", "operator"};
    return names[role];
}

static bool has_id(const struct ls_access_ids *list, unsigned id)
{
    for (unsigned i = 0; i < list->n; i++)
        if (list->id[i] == id)
            return true;
    return false;
}

static bool has_any(const struct ls_access_ids *list, const gid_t *groups, size_t n_groups)
{
    for (size_t i = 0; i < n_groups; i++)
        if (has_id(list, groups[i]))
            return true;
    return false;
}

static bool has_name(const struct ls_access_names *list, const char *name)
{
    for (unsigned i = 0; i < list->n; i++)
        if (strcmp(list->name[i], name) == 0)
            return true;
    return false;
}

enum ls_role ls_access_unix(const struct ls_access *access, unsigned uid, const gid_t *groups,
                            size_t n_groups)
{
    if (!access->listed || has_id(&access->operator_uids, uid) ||
        has_any(&access->operator_gids, groups, n_groups))
        return LS_ROLE_OPERATOR;
    if (has_id(&access->reader_uids, uid) || has_any(&access->reader_gids, groups, n_groups))
        return LS_ROLE_READER;
    return LS_ROLE_NONE;
}

enum ls_role ls_access_certificate(const struct ls_access *access, const char *common_name)
{
    if (has_name(&access->operators, common_name))
        return LS_ROLE_OPERATOR;
    return has_name(&access->readers, common_name) ? LS_ROLE_READER : LS_ROLE_NONE;
}

static void finish_names(struct ls_access_names *list)
{
    for (unsigned i = 0; i < list->n; i++)
        free(list->name[i]);
    list->n = 0;
}

void ls_access_finish(struct ls_access *access)
{
    finish_names(&access->operators);
    finish_names(&access->readers);
}
