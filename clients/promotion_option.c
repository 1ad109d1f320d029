#include "clients/promotion_option.h"

#include "clients/command.h"
#include "proto/models.h"

int ls_promotion_option(int option, const char *word, Lightstage__Promotion *out)
{
    switch (option) {
    case LS_OPTION_MODEL:
        return ls_model_by_name(word, &out->model)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--model %s: expected measured, sphere, headlight, separated "
                                      "or linear",
                                      word);
    case LS_OPTION_REFERENCE:
        return ls_reference_by_name(word, &out->reference)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--reference %s: expected strengths or paper", word);
    case LS_OPTION_IDEAL:
        out->ideal_polarisation = true;
        return LS_EXIT_OK;
    case LS_OPTION_PLAIN:
        out->plain_conductors = true;
        return LS_EXIT_OK;
    default:
        return LS_EXIT_USAGE;
    }
}
