/*
 * library: what the parts of liblightstage share: requests in flight, errors, structs of any age.
 * Layer: clients. Threads: the client's one. Ownership: the client's.
 */
#ifndef LS_CLIENTS_LIBRARY_H
#define LS_CLIENTS_LIBRARY_H

#include "clients/connection.h"
#include "clients/lightstage.h"

struct ls_in_flight;

struct lightstage {
    struct ls_connection *connection;
    struct ls_in_flight *first;
    ProtobufCMessage *hello; /* HelloReply */
    bool lost;
};

/** Called with each reply of a request; not 0: the number it ends with, and it is cancelled. */
typedef uint32_t ls_on_reply(const struct ls_reply *reply, void *user,
                             struct lightstage_error *error);

/** Fill @error (NULL is allowed) and return @number. */
uint32_t ls_library_fail(struct lightstage_error *error, uint32_t number, const char *fmt, ...)
    LS_PRINTF(3, 4);

/** What a reply ends with whose callback returned @stop: 0, or LIGHTSTAGE_CANCELLED. */
uint32_t ls_library_stopped(int stop, struct lightstage_error *error);

/** The library's number for what a connection says. */
uint32_t ls_library_number(enum ls_err err);

/** Copy the struct @from of a caller, which begins with its size, to @to of @bytes, which is what
 * this library knows of it; what @from lacks is 0. 107, 108. */
uint32_t ls_library_take_in(void *to, size_t bytes, const void *from,
                            struct lightstage_error *error);

/** Send a request whose replies go to @on_reply with a copy of the @user_bytes at @user. */
uint32_t ls_library_begin(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                          const void *payload, size_t payload_bytes, ls_on_reply *on_reply,
                          const void *user, size_t user_bytes, uint32_t *request,
                          struct lightstage_error *error);

/** Send a request and wait for its end. @on_reply NULL: its reply says nothing. */
uint32_t ls_library_call(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                         const void *payload, size_t payload_bytes, ls_on_reply *on_reply,
                         const void *user, size_t user_bytes, struct lightstage_error *error);

/** Send a request whose reply is of no interest. */
uint32_t ls_library_tell(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                         struct lightstage_error *error);

/** Its texts are @status's. */
struct lightstage_take_status ls_library_take_status(const Lightstage__TakeStatus *status);

/** Its texts are @report's. */
struct lightstage_spectrum ls_library_spectrum(const Lightstage__SpectrumReport *report);

/** Memory of @bytes, all 0, which also keeps the message of @reply: it is the memory's from now on,
 * and what it says may be pointed to. NULL: no memory, and @error says so. ls_library_release. */
void *ls_library_keep(const struct ls_reply *reply, size_t bytes, struct lightstage_error *error);

/** NULL is allowed. */
void ls_library_release(void *kept);

/** The first @bytes of the memory behind @fd, read-only, munmap; if it has @seals (F_SEAL_*: what
 * nobody can do to it any more) and is as long. LIGHTSTAGE_STRANGE, LIGHTSTAGE_NO_MEMORY. */
uint32_t ls_library_map(int fd, uint64_t bytes, int seals, const void **out,
                        struct lightstage_error *error);

/** What a caller gets of a reply, by ls_library_keep; NULL: @error says why. */
typedef void *ls_make_kept(const struct ls_reply *reply, struct lightstage_error *error);

/** Send a request and wait for its one reply; what @make makes of it goes to *@out, a pointer. */
uint32_t ls_library_ask(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                        const void *payload, size_t payload_bytes, ls_make_kept *make, void *out,
                        struct lightstage_error *error);

#endif
