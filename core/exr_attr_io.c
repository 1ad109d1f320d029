#include "core/exr_source.h"

#include <string.h>

exr_result_t ls_exr_attr_put(exr_context_t context, int part, const struct ls_exr_attr *attr)
{
    switch (attr->kind) {
    case LS_EXR_ATTR_STRING:
        return exr_attr_set_string(context, part, attr->name, attr->text);
    case LS_EXR_ATTR_INT:
        return exr_attr_set_int(context, part, attr->name, attr->i);
    case LS_EXR_ATTR_FLOAT:
        return exr_attr_set_float(context, part, attr->name, attr->f[0]);
    case LS_EXR_ATTR_V2F: {
        exr_attr_v2f_t v = {.x = attr->f[0], .y = attr->f[1]};
        return exr_attr_set_v2f(context, part, attr->name, &v);
    }
    case LS_EXR_ATTR_V3F: {
        exr_attr_v3f_t v = {.x = attr->f[0], .y = attr->f[1], .z = attr->f[2]};
        return exr_attr_set_v3f(context, part, attr->name, &v);
    }
    case LS_EXR_ATTR_M44F: {
        exr_attr_m44f_t m;
        memcpy(m.m, attr->f, sizeof m.m);
        return exr_attr_set_m44f(context, part, attr->name, &m);
    }
    case LS_EXR_ATTR_CHROMATICITIES: {
        exr_attr_chromaticities_t c;
        memcpy(&c, attr->f, sizeof c);
        return exr_attr_set_chromaticities(context, part, attr->name, &c);
    }
    case LS_EXR_ATTR_TIMECODE: {
        exr_attr_timecode_t t = {attr->tc[0], attr->tc[1]};
        return exr_attr_set_timecode(context, part, attr->name, &t);
    }
    }
    return EXR_ERR_INVALID_ARGUMENT;
}

static void copy_attr(struct ls_exr_attrs *attrs, const exr_attribute_t *attr)
{
    switch (attr->type) {
    case EXR_ATTR_STRING:
        ls_exr_attrs_string(attrs, attr->name, attr->string->str ? attr->string->str : "");
        break;
    case EXR_ATTR_INT:
        ls_exr_attrs_int(attrs, attr->name, attr->i);
        break;
    case EXR_ATTR_FLOAT:
        ls_exr_attrs_float(attrs, attr->name, attr->f);
        break;
    case EXR_ATTR_V2F:
        ls_exr_attrs_v2f(attrs, attr->name, (float[2]){attr->v2f->x, attr->v2f->y});
        break;
    case EXR_ATTR_V3F:
        ls_exr_attrs_v3f(attrs, attr->name, (float[3]){attr->v3f->x, attr->v3f->y, attr->v3f->z});
        break;
    case EXR_ATTR_M44F:
        ls_exr_attrs_m44f(attrs, attr->name, attr->m44f->m);
        break;
    case EXR_ATTR_CHROMATICITIES: {
        float c[8];
        memcpy(c, attr->chromaticities, sizeof c);
        ls_exr_attrs_chromaticities(attrs, attr->name, c);
        break;
    }
    case EXR_ATTR_TIMECODE:
        ls_exr_attrs_timecode(attrs, attr->name, attr->timecode->time_and_flags,
                              attr->timecode->user_data);
        break;
    default:
        break;
    }
}

enum ls_err ls_exr_source_attrs(const struct ls_exr_source *source, int part,
                                struct ls_exr_attrs *attrs, struct ls_diag *diag)
{
    int32_t n = 0;
    exr_result_t r = exr_get_attribute_count(source->context, part, &n);
    for (int32_t k = 0; k < n && !r; k++) {
        const exr_attribute_t *attr = NULL;
        r = exr_get_attribute_by_index(source->context, part, EXR_ATTR_LIST_FILE_ORDER, k, &attr);
        /* a name of 32 and more characters is none of ours */
        if (!r && strlen(attr->name) <= 31)
            copy_attr(attrs, attr);
    }
    if (r)
        return ls_exr_source_fail(source, r, "cannot read the attributes", diag);
    if (attrs->err == LS_ERR_NOMEM)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for the attributes");
    attrs->err = LS_OK;
    return LS_OK;
}
