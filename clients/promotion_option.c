#include "clients/promotion_option.h"

#include "clients/command.h"

int ls_promotion_option(int option, const char *word, struct lightstage_promotion *out)
{
    switch (option) {
    case LS_OPTION_MODEL:
        return lightstage_model_by_name(word, &out->model)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--model %s: expected measured, sphere, headlight, separated "
                                      "or linear",
                                      word);
    case LS_OPTION_REFERENCE:
        return lightstage_reference_by_name(word, &out->reference)
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
