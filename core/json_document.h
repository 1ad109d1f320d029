/*
 * json_document: what every JSON file that a person hands over begins with, and the directions in
 * it. Private to those who parse one.
 * Layer: core. Threads: any. Ownership: the caller's.
 */
#ifndef LS_CORE_JSON_DOCUMENT_H
#define LS_CORE_JSON_DOCUMENT_H

#include "core/error.h"

#include <jansson.h>
#include <stddef.h>

/**
 * An object with "format": 1, without duplicate keys. @what begins every sentence. @root: (transfer
 * full). Errors: LS_ERR_LIMIT (more than @most bytes), LS_ERR_INVALID (with line and column, or the
 * key), LS_ERR_UNSUPPORTED (another format).
 */
LS_MUST_CHECK enum ls_err ls_json_document(const char *what, const char *text, size_t bytes,
                                           size_t most, json_t **root, struct ls_diag *diag);

/** Exactly @n finite numbers under @key of @object. LS_ERR_INVALID. */
LS_MUST_CHECK enum ls_err ls_json_numbers(const char *what, const json_t *object, const char *key,
                                          size_t n, double *out, struct ls_diag *diag);

/** Three of them that are a direction, of any length; @out is of length 1. LS_ERR_INVALID. */
LS_MUST_CHECK enum ls_err ls_json_unit(const char *what, const json_t *object, const char *key,
                                       double out[3], struct ls_diag *diag);

#endif
