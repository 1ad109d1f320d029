#include "proto/models.h"

#include <string.h>

static const char *const models[] = {"measured", "sphere", "headlight", "separated", "linear"};
static const char *const references[] = {"strengths", "paper"};
enum {
    N_MODELS = sizeof models / sizeof *models,
    N_REFERENCES = sizeof references / sizeof *references
};

const char *ls_model_name(Lightstage__Model model)
{
    return (unsigned)model < N_MODELS ? models[model] : NULL;
}

const char *ls_reference_name(Lightstage__Reference reference)
{
    return (unsigned)reference < N_REFERENCES ? references[reference] : NULL;
}

bool ls_model_by_name(const char *name, Lightstage__Model *out)
{
    for (unsigned i = 0; i < N_MODELS; i++)
        if (strcmp(name, models[i]) == 0) {
            *out = (Lightstage__Model)i;
            return true;
        }
    return false;
}

bool ls_reference_by_name(const char *name, Lightstage__Reference *out)
{
    for (unsigned i = 0; i < N_REFERENCES; i++)
        if (strcmp(name, references[i]) == 0) {
            *out = (Lightstage__Reference)i;
            return true;
        }
    return false;
}
