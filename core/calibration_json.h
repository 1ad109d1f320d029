/*
 * calibration_json: reading values out of a calibration's JSON, each with the sentence that names
 * the path of what was wrong; and writing them. Private to the calibration's own files.
 * Layer: core. Threads: any. Ownership: everything is the caller's.
 *
 * Every function that reads: @path is where the value stands, LS_ERR_INVALID says what was expected
 * there and what was found, LS_ERR_LIMIT that there is too much of it.
 */
#ifndef LS_CORE_CALIBRATION_JSON_H
#define LS_CORE_CALIBRATION_JSON_H

#include "core/calibration.h"

#include <jansson.h>

enum ls_err ls_json_wrong(struct ls_diag *diag, const char *path, const char *expected,
                          const json_t *found);

/** Path of a child: "parent.key" or "parent[index]", truncated if absurdly long. */
const char *ls_json_child(char buffer[160], const char *path, const char *key);
const char *ls_json_element(char buffer[160], const char *path, size_t index);

/** A number in [@low, @high]; the second one, a member of an object. */
LS_MUST_CHECK enum ls_err ls_json_number(const json_t *value, const char *path, double low,
                                         double high, double *out, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_json_member(const json_t *object, const char *path, const char *key,
                                         double low, double high, double *out,
                                         struct ls_diag *diag);

/** A string of 1 to @size - 1 bytes. */
LS_MUST_CHECK enum ls_err ls_json_string(const json_t *value, const char *path, size_t size,
                                         char *out, struct ls_diag *diag);

/** An array of exactly @n elements; of at most @most. */
LS_MUST_CHECK enum ls_err ls_json_array(const json_t *value, const char *path, size_t n,
                                        struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_json_bounded(const json_t *value, const char *path, size_t most,
                                          struct ls_diag *diag);

/** @n numbers in [@low, @high]; @n vectors within +-1000; @n unit vectors (within 1e-3). */
LS_MUST_CHECK enum ls_err ls_json_floats(const json_t *value, const char *path, size_t n,
                                         double low, double high, float *out, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_json_vectors(const json_t *value, const char *path, uint32_t n,
                                          float (*out)[3], struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_json_directions(const json_t *value, const char *path, uint32_t n,
                                             float (*out)[3], struct ls_diag *diag);

/** Arrays of @n floats, and of @n_rows rows of them; NULL where one is no number or memory is out.
 * (transfer full) */
json_t *ls_json_of_floats(const float *v, size_t n);
json_t *ls_json_of_rows(const float *v, size_t n_rows, size_t n);

/** Append or set @value (transfer full). Where that fails, as for a value of NULL, *@to is released
 * and becomes NULL, so that what lacks a part is not written at all. */
void ls_json_append(json_t **to, json_t *value);
void ls_json_set(json_t **to, const char *key, json_t *value);

/** The optional keys of @root into @calibration, whose required ones are there already.
 * (core/calibration_optional.c) */
LS_MUST_CHECK enum ls_err ls_calibration_parse_optional(const json_t *root,
                                                        struct ls_calibration *calibration,
                                                        struct ls_diag *diag);

/** And back: the optional keys that hold something, set in *@root as by ls_json_set. */
void ls_calibration_write_optional(const struct ls_calibration *calibration, json_t **root);

#endif
