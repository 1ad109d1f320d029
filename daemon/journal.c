#include "daemon/journal.h"

#include "core/crc32c.h"

#include <jansson.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LINE_LIMIT_BYTES = 4 << 20, PREFIX_BYTES = 9, MAX_PX = 65536 };

/* ---- tickets: one table for writing and reading ---- */

enum kind { U32, U64, REAL, STATUS };

static const struct field {
    const char *name;
    enum kind kind;
    size_t offset;
} fields[] = {
#define FIELD(name, kind)                             \
    {                                                 \
#name, kind, offsetof(struct ls_ticket, name) \
    }
    FIELD(shot, U32),
    FIELD(step, U32),
    FIELD(camera, U32),
    FIELD(attempt, U32),
    FIELD(condition, U32),
    FIELD(exposure, U32),
    FIELD(repeat, U32),
    FIELD(pulse_us, REAL),
    FIELD(controller_step, U32),
    FIELD(width_us, U32),
    FIELD(controller_us, U64),
    FIELD(frame_id, U64),
    FIELD(camera_ns, U64),
    FIELD(host_ns, U64),
    FIELD(status, STATUS),
    FIELD(trigger_counter, U32),
    FIELD(chunk_exposure_us, REAL),
    FIELD(exposure_used_us, REAL),
    FIELD(residual_us, REAL),
    FIELD(raw_crc32c, U32),
    FIELD(raw_bytes, U32),
#undef FIELD
};

static json_t *field_value(const struct field *field, const struct ls_ticket *ticket)
{
    const char *at = (const char *)ticket + field->offset;
    switch (field->kind) {
    case U32:
        return json_integer(*(const uint32_t *)at);
    case U64:
        return json_integer((json_int_t) * (const uint64_t *)at);
    case REAL:
        return json_real(*(const double *)at);
    case STATUS:
        return json_string(ticket->status == LS_FRAME_OK ? "ok" : "lost");
    }
    return NULL;
}

static bool set_field(const struct field *field, const json_t *value, struct ls_ticket *ticket)
{
    char *at = (char *)ticket + field->offset;
    const char *text = json_string_value(value);
    json_int_t number = json_integer_value(value);
    if (field->kind == STATUS) {
        ticket->status = text && !strcmp(text, "ok") ? LS_FRAME_OK : LS_FRAME_LOST;
        return text && (!strcmp(text, "ok") || !strcmp(text, "lost"));
    }
    if (field->kind == REAL) {
        *(double *)at = json_number_value(value);
        return json_is_number(value);
    }
    if (field->kind == U32)
        *(uint32_t *)at = (uint32_t)number;
    else
        *(uint64_t *)at = (uint64_t)number;
    return json_is_integer(value) && (field->kind == U64 || (number >= 0 && number <= UINT32_MAX));
}

/* ---- writing ---- */

static bool reserve(struct ls_journal_batch *batch, size_t n)
{
    if (batch->n + n <= batch->capacity)
        return true;
    size_t capacity = 2 * batch->capacity + n;
    char *text = realloc(batch->text, capacity);
    if (!text)
        return false;
    batch->text = text;
    batch->capacity = capacity;
    return true;
}

/* Append a record and drop the reference to @record. A number that is not finite has no JSON. */
static enum ls_err add(struct ls_journal_batch *batch, json_t *record)
{
    char *json = record ? json_dumps(record, JSON_COMPACT) : NULL;
    json_decref(record);
    if (!json)
        return LS_ERR_NOMEM;
    size_t n = strlen(json);
    enum ls_err err = n + PREFIX_BYTES > LINE_LIMIT_BYTES     ? LS_ERR_LIMIT
                      : !reserve(batch, n + PREFIX_BYTES + 2) ? LS_ERR_NOMEM
                                                              : LS_OK;
    if (!err)
        batch->n +=
            (size_t)sprintf(batch->text + batch->n, "%08x %s\n", ls_crc32c(0, json, n), json);
    free(json);
    return err;
}

enum ls_err ls_journal_add_ticket(struct ls_journal_batch *batch, const struct ls_ticket *ticket)
{
    if (!isfinite(ticket->pulse_us) || !isfinite(ticket->chunk_exposure_us) ||
        !isfinite(ticket->exposure_used_us) || !isfinite(ticket->residual_us))
        return LS_ERR_INVALID;
    json_t *record = json_pack("{s:s}", "k", "ticket");
    for (size_t k = 0; record && k < sizeof fields / sizeof *fields; k++)
        if (json_object_set_new(record, fields[k].name, field_value(&fields[k], ticket))) {
            json_decref(record);
            record = NULL;
        }
    return add(batch, record);
}

static json_t *hex(const uint32_t *values, uint32_t n, int digits)
{
    char *text = malloc((size_t)n * digits + 1);
    if (!text)
        return NULL;
    text[0] = 0;
    for (uint32_t k = 0; k < n; k++)
        sprintf(text + (size_t)k * digits, "%0*x", digits, values[k]);
    json_t *string = json_string(text);
    free(text);
    return string;
}

static json_t *integers(const uint32_t *values, uint32_t n)
{
    json_t *array = json_array();
    for (uint32_t k = 0; k < n; k++)
        if (json_array_append_new(array, json_integer(values[k]))) {
            json_decref(array);
            return NULL;
        }
    return array;
}

enum ls_err ls_journal_add_published(struct ls_journal_batch *batch, const struct ls_published *p)
{
    json_t *record = json_pack(
        "{s:s, s:s, s:I, s:s, s:I, s:I, s:I, s:s, s:o, s:o}", "k", "published", "condition",
        p->condition, "camera", (json_int_t)p->camera, "file", p->file, "bytes",
        (json_int_t)p->bytes, "width", (json_int_t)p->width, "height", (json_int_t)p->height,
        "type", p->is_float ? "float" : "half", "crc", hex(p->tile_crc, p->n_tiles, 8), "max",
        hex(p->tile_max, p->n_tiles, p->is_float ? 8 : 4));
    if (record && p->tile_invalid &&
        (json_object_set_new(record, "invalid", integers(p->tile_invalid, p->n_tiles)) ||
         json_object_set_new(record, "validity", json_integer(p->validity_crc)))) {
        json_decref(record);
        record = NULL;
    }
    return add(batch, record);
}

static enum ls_err add_text(struct ls_journal_batch *batch, const char *kind, uint64_t host_ns,
                            const char *key, const char *text)
{
    json_t *string = json_string(text);
    if (!string)
        string = json_string("(text that is not UTF-8)");
    return add(batch,
               json_pack("{s:s, s:I, s:o}", "k", kind, "t", (json_int_t)host_ns, key, string));
}

enum ls_err ls_journal_add_alarm(struct ls_journal_batch *batch, uint64_t host_ns, const char *text)
{
    return add_text(batch, "alarm", host_ns, "text", text);
}

enum ls_err ls_journal_add_state(struct ls_journal_batch *batch, uint64_t host_ns,
                                 const char *state)
{
    return add_text(batch, "state", host_ns, "state", state);
}

enum ls_err ls_journal_add_batch(struct ls_journal_batch *batch,
                                 const struct ls_journal_batch *other)
{
    if (!reserve(batch, other->n))
        return LS_ERR_NOMEM;
    if (other->n)
        memcpy(batch->text + batch->n, other->text, other->n);
    batch->n += other->n;
    return LS_OK;
}

void ls_journal_batch_finish(struct ls_journal_batch *batch)
{
    free(batch->text);
    *batch = (struct ls_journal_batch){0};
}

void ls_published_finish(struct ls_published *published)
{
    free(published->tile_crc);
    free(published->tile_max);
    free(published->tile_invalid);
    *published = (struct ls_published){0};
}

/* ---- reading ---- */

static bool hex_value(const char *text, int digits, uint32_t *value)
{
    *value = 0;
    for (int k = 0; k < digits; k++) {
        char c = text[k];
        if (!((c >= '0' && c <= '9') || (c >= 'a' && c <= 'f')))
            return false;
        *value = *value << 4 | (uint32_t)(c <= '9' ? c - '0' : c - 'a' + 10);
    }
    return true;
}

static uint32_t *parse_hex(const json_t *string, uint32_t n, int digits)
{
    if (!json_is_string(string) || json_string_length(string) != (size_t)n * digits)
        return NULL;
    const char *text = json_string_value(string);
    uint32_t *values = malloc(n * sizeof *values);
    for (uint32_t k = 0; values && k < n; k++)
        if (!hex_value(text + (size_t)k * digits, digits, &values[k])) {
            free(values);
            return NULL;
        }
    return values;
}

static uint32_t *parse_integers(const json_t *array, uint32_t n)
{
    if (!json_is_array(array) || json_array_size(array) != n)
        return NULL;
    uint32_t *values = malloc(n * sizeof *values);
    for (uint32_t k = 0; values && k < n; k++) {
        json_int_t value = json_integer_value(json_array_get(array, k));
        if (value < 0 || value > UINT32_MAX) {
            free(values);
            return NULL;
        }
        values[k] = (uint32_t)value;
    }
    return values;
}

static bool copy_name(char *to, size_t size, const json_t *string)
{
    const char *text = json_string_value(string);
    if (!text || !*text || strlen(text) >= size || strstr(text, "..") || *text == '/')
        return false;
    strcpy(to, text);
    return true;
}

static bool parse_published(const json_t *record, struct ls_published *p)
{
    json_int_t camera = -1, bytes = -1, width = 0, height = 0, validity = 0;
    const char *type = json_string_value(json_object_get(record, "type"));
    const json_t *invalid = json_object_get(record, "invalid");
    if (json_unpack((json_t *)record, "{s:I, s:I, s:I, s:I, s?I}", "camera", &camera, "bytes",
                    &bytes, "width", &width, "height", &height, "validity", &validity) ||
        camera < 0 || camera > UINT32_MAX || bytes < 0 || width < 1 || width > MAX_PX ||
        height < 1 || height > MAX_PX || validity < 0 || validity > UINT32_MAX || !type ||
        (strcmp(type, "half") && strcmp(type, "float")))
        return false;
    p->camera = (uint32_t)camera;
    p->bytes = (uint64_t)bytes;
    p->width = (uint32_t)width;
    p->height = (uint32_t)height;
    p->is_float = !strcmp(type, "float");
    p->n_tiles = (p->width + 63) / 64 * ((p->height + 63) / 64);
    p->validity_crc = (uint32_t)validity;
    p->tile_crc = parse_hex(json_object_get(record, "crc"), p->n_tiles, 8);
    p->tile_max = parse_hex(json_object_get(record, "max"), p->n_tiles, p->is_float ? 8 : 4);
    p->tile_invalid = invalid ? parse_integers(invalid, p->n_tiles) : NULL;
    return p->tile_crc && p->tile_max && !invalid == !p->tile_invalid &&
           copy_name(p->condition, sizeof p->condition, json_object_get(record, "condition")) &&
           copy_name(p->file, sizeof p->file, json_object_get(record, "file"));
}

static enum ls_err tell_ticket(const struct ls_journal_reader *reader, const json_t *record)
{
    struct ls_ticket ticket = {0};
    for (size_t k = 0; k < sizeof fields / sizeof *fields; k++)
        if (!set_field(&fields[k], json_object_get(record, fields[k].name), &ticket))
            return LS_ERR_INVALID;
    return reader->ticket ? reader->ticket(reader->user, &ticket) : LS_OK;
}

static enum ls_err tell_published(const struct ls_journal_reader *reader, const json_t *record)
{
    struct ls_published published = {0};
    enum ls_err err = parse_published(record, &published) ? LS_OK : LS_ERR_INVALID;
    if (!err && reader->published)
        err = reader->published(reader->user, &published);
    ls_published_finish(&published);
    return err;
}

static enum ls_err tell(const struct ls_journal_reader *reader, const json_t *record)
{
    const char *kind = json_string_value(json_object_get(record, "k"));
    const char *text = json_string_value(json_object_get(record, "text"));
    const char *state = json_string_value(json_object_get(record, "state"));
    if (!kind)
        return LS_ERR_INVALID;
    if (!strcmp(kind, "ticket"))
        return tell_ticket(reader, record);
    if (!strcmp(kind, "published"))
        return tell_published(reader, record);
    if (!strcmp(kind, "alarm"))
        return !text ? LS_ERR_INVALID : reader->alarm ? reader->alarm(reader->user, text) : LS_OK;
    if (!strcmp(kind, "state"))
        return !state ? LS_ERR_INVALID : reader->state ? reader->state(reader->user, state) : LS_OK;
    return LS_OK;
}

/* Is [line, line + n) with its newline a record whose checksum holds? */
static bool whole(const char *line, size_t n)
{
    uint32_t crc;
    return n > PREFIX_BYTES && n <= LINE_LIMIT_BYTES && line[8] == ' ' &&
           hex_value(line, 8, &crc) && crc == ls_crc32c(0, line + PREFIX_BYTES, n - PREFIX_BYTES);
}

static bool good_one_after(const char *at, const char *end)
{
    for (const char *newline; (newline = memchr(at, '\n', (size_t)(end - at))); at = newline + 1)
        if (whole(at, (size_t)(newline - at)))
            return true;
    return false;
}

enum ls_err ls_journal_replay(const char *text, size_t n, const struct ls_journal_reader *reader,
                              size_t *n_good, struct ls_diag *diag)
{
    const char *at = text, *end = text + n;
    for (size_t number = 1; at < end; number++) {
        const char *newline = memchr(at, '\n', (size_t)(end - at));
        size_t length = newline ? (size_t)(newline - at) : 0;
        *n_good = (size_t)(at - text);
        if (!newline || !whole(at, length)) {
            if (newline && good_one_after(newline + 1, end))
                return ls_fail(diag, LS_ERR_INVALID,
                               "journal: line %zu is damaged and good "
                               "records follow it; restore the file from a copy",
                               number);
            return LS_OK;
        }
        json_error_t error;
        json_t *record =
            json_loadb(at + PREFIX_BYTES, length - PREFIX_BYTES, JSON_REJECT_DUPLICATES, &error);
        enum ls_err err = json_is_object(record) ? tell(reader, record) : LS_ERR_INVALID;
        json_decref(record);
        if (err)
            return ls_fail(diag, err, "journal: line %zu: %s", number,
                           err == LS_ERR_INVALID ? "its checksum holds, its contents make no sense"
                                                 : ls_err_name(err));
        at = newline + 1;
    }
    *n_good = n;
    return LS_OK;
}
