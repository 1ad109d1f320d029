/*
 * models: the words for the models of promotion and their references.
 * Layer: proto. Threads: any. Ownership: none.
 */
#ifndef LS_PROTO_MODELS_H
#define LS_PROTO_MODELS_H

#include "proto/lightstage.pb-c.h"

#include <stdbool.h>

/** "measured", "sphere", "headlight", "separated", "linear"; NULL for a number that is none.
 * RT-safe.
 */
const char *ls_model_name(Lightstage__Model model);

/** False: no model of this name. RT-safe. */
bool ls_model_by_name(const char *name, Lightstage__Model *out);

/** "strengths", "paper"; NULL for a number that is none. RT-safe. */
const char *ls_reference_name(Lightstage__Reference reference);

/** False: no reference of this name. RT-safe. */
bool ls_reference_by_name(const char *name, Lightstage__Reference *out);

#endif
