/* Words for numbers. */
#include "clients/library.h"

#include "proto/errors.h"
#include "proto/models.h"

const char *lightstage_error_name(uint32_t number)
{
    static const char *const own[] = {
        [LIGHTSTAGE_UNREACHABLE] = "unreachable", [LIGHTSTAGE_LOST] = "connection lost",
        [LIGHTSTAGE_NO_MEMORY] = "out of memory", [LIGHTSTAGE_UNTRUSTED] = "not trusted",
        [LIGHTSTAGE_STRANGE] = "strange answer",
    };
    return number > 0 && number < sizeof own / sizeof *own ? own[number]
                                                           : ls_proto_error_name(number);
}

const char *lightstage_model_name(enum lightstage_model model)
{
    return ls_model_name((Lightstage__Model)model);
}

const char *lightstage_reference_name(enum lightstage_reference reference)
{
    return ls_reference_name((Lightstage__Reference)reference);
}

int lightstage_model_by_name(const char *name, enum lightstage_model *out)
{
    Lightstage__Model model;
    bool known = ls_model_by_name(name, &model);
    if (known)
        *out = (enum lightstage_model)model;
    return known;
}

int lightstage_reference_by_name(const char *name, enum lightstage_reference *out)
{
    Lightstage__Reference reference;
    bool known = ls_reference_by_name(name, &reference);
    if (known)
        *out = (enum lightstage_reference)reference;
    return known;
}
