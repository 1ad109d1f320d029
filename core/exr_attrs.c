#include "core/exr.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { NAME_MAX_LENGTH = 31 };

static void latch(struct ls_exr_attrs *attrs, enum ls_err err, const char *name)
{
    if (attrs->err)
        return;
    attrs->err = err;
    strncpy(attrs->err_name, name, sizeof attrs->err_name - 1);
}

static bool name_ok(const char *name)
{
    size_t n = strlen(name);
    if (n < 1 || n > NAME_MAX_LENGTH)
        return false;
    for (const char *c = name; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            return false;
    return true;
}

static struct ls_exr_attr *append(struct ls_exr_attrs *attrs)
{
    if (attrs->n == attrs->capacity) {
        size_t capacity = attrs->capacity ? 2 * attrs->capacity : 16;
        struct ls_exr_attr *items = realloc(attrs->items, capacity * sizeof *items);
        if (!items)
            return NULL;
        attrs->items = items;
        attrs->capacity = capacity;
    }
    return &attrs->items[attrs->n++];
}

/* The slot for @name, emptied; NULL with the error latched. */
static struct ls_exr_attr *slot(struct ls_exr_attrs *attrs, const char *name,
                                enum ls_exr_attr_kind kind)
{
    if (!name_ok(name)) {
        latch(attrs, LS_ERR_INVALID, name);
        return NULL;
    }
    struct ls_exr_attr *attr = (struct ls_exr_attr *)ls_exr_attrs_find(attrs, name);
    if (attr)
        free(attr->text);
    else
        attr = append(attrs);
    if (!attr) {
        latch(attrs, LS_ERR_NOMEM, name);
        return NULL;
    }
    *attr = (struct ls_exr_attr){.kind = kind};
    strcpy(attr->name, name);
    return attr;
}

static void set_floats(struct ls_exr_attrs *attrs, const char *name, enum ls_exr_attr_kind kind,
                       const float *values, size_t n)
{
    struct ls_exr_attr *attr = slot(attrs, name, kind);
    if (attr)
        memcpy(attr->f, values, n * sizeof *values);
}

void ls_exr_attrs_string(struct ls_exr_attrs *attrs, const char *name, const char *value)
{
    struct ls_exr_attr *attr = slot(attrs, name, LS_EXR_ATTR_STRING);
    if (attr && !(attr->text = strdup(value)))
        latch(attrs, LS_ERR_NOMEM, name);
}

void ls_exr_attrs_int(struct ls_exr_attrs *attrs, const char *name, int32_t value)
{
    struct ls_exr_attr *attr = slot(attrs, name, LS_EXR_ATTR_INT);
    if (attr)
        attr->i = value;
}

void ls_exr_attrs_float(struct ls_exr_attrs *attrs, const char *name, float value)
{
    set_floats(attrs, name, LS_EXR_ATTR_FLOAT, &value, 1);
}

void ls_exr_attrs_v2f(struct ls_exr_attrs *attrs, const char *name, const float value[2])
{
    set_floats(attrs, name, LS_EXR_ATTR_V2F, value, 2);
}

void ls_exr_attrs_v3f(struct ls_exr_attrs *attrs, const char *name, const float value[3])
{
    set_floats(attrs, name, LS_EXR_ATTR_V3F, value, 3);
}

void ls_exr_attrs_m44f(struct ls_exr_attrs *attrs, const char *name, const float value[16])
{
    set_floats(attrs, name, LS_EXR_ATTR_M44F, value, 16);
}

void ls_exr_attrs_chromaticities(struct ls_exr_attrs *attrs, const char *name, const float value[8])
{
    set_floats(attrs, name, LS_EXR_ATTR_CHROMATICITIES, value, 8);
}

void ls_exr_attrs_timecode(struct ls_exr_attrs *attrs, const char *name, uint32_t time_and_flags,
                           uint32_t user)
{
    struct ls_exr_attr *attr = slot(attrs, name, LS_EXR_ATTR_TIMECODE);
    if (attr) {
        attr->tc[0] = time_and_flags;
        attr->tc[1] = user;
    }
}

const struct ls_exr_attr *ls_exr_attrs_find(const struct ls_exr_attrs *attrs, const char *name)
{
    for (size_t k = 0; k < attrs->n; k++)
        if (!strcmp(attrs->items[k].name, name))
            return &attrs->items[k];
    return NULL;
}

void ls_exr_attrs_finish(struct ls_exr_attrs *attrs)
{
    for (size_t k = 0; k < attrs->n; k++)
        free(attrs->items[k].text);
    free(attrs->items);
    *attrs = (struct ls_exr_attrs){0};
}
