#include "tests/bench/serving.h"

#include "daemon/picture_map.h"
#include "daemon/realtime.h"
#include "proto/frame.h"
#include "tests/bench/bench.h"
#include "tests/bench/references.h"
#include "tests/daemon/store_fixture.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

static void must(bool ok, const char *what)
{
    if (!ok) {
        fprintf(stderr, "%s\n", what);
        exit(1);
    }
}

/* ---- the take ---- */

static void add_condition(GString *json, const char *id, const char *kind, const char *channel,
                          uint32_t light)
{
    g_string_append_printf(
        json,
        "%s{\"id\": \"%s\", \"kind\": \"%s\", \"channel\": \"%s\", \"light\": %u, \"level\": "
        "65535, \"repeats\": 1}",
        json->str[json->len - 1] == '[' ? "" : ", ", id, kind, channel, light);
}

static char *json_of(const struct serving *s, char **ids)
{
    GString *json = g_string_new("{\"plan\": {\"text\": \"x\", \"subject\": \"still\", "
                                 "\"pulse_us\": [], \"conditions\": [");
    for (uint32_t i = 0; i < s->n_lights; i++)
        add_condition(json, ids[i], "one", "W", i);
    add_condition(json, ids[s->n_lights], "sphere", "W", 0);
    add_condition(json, ids[s->n_lights + 1], "sphere", "R", 0);
    g_string_append(json, "]}, \"rig\": {\"name\": \"bench\", \"lights\": {\"position_m\": [");
    for (uint32_t i = 0; i < s->n_lights; i++) {
        double z = 1 - 2 * (i + 0.5) / s->n_lights, a = 2.4 * i, r = sqrt(1 - z * z);
        g_string_append_printf(json, "%s[%.9g, %.9g, %.9g]", i ? ", " : "", r * cos(a), z,
                               r * sin(a));
    }
    g_string_append_printf(
        json,
        "]}, \"channels\": [{\"name\": \"W\", \"kind\": \"spectrum\"}, {\"name\": \"R\", \"kind\": "
        "\"spectrum\"}], \"cameras\": [{\"name\": \"front\", \"pixel_format\": \"BayerRG12\", "
        "\"width\": %u, \"height\": %u, \"full_scale_dn\": 4095.0, \"electrons_per_dn\": 10.0, "
        "\"read_noise_dn\": 2.0, \"black_dn\": 64.0, \"range\": [0.1, 0.85]}]}, \"exposure_s\": "
        "[0.01], \"reference_exposure_s\": 0.01, \"calibration\": null}",
        s->side, s->side);
    return g_string_free(json, FALSE);
}

static void publish_all(const struct serving *s, struct ls_store *store, char **ids)
{
    size_t n = (size_t)s->side * s->side;
    uint16_t *half = bench_alloc(n * sizeof *half);
    for (uint32_t i = 0; i < s->n_lights + 2; i++) {
        for (size_t k = 0; k < n; k++)
            half[k] = (uint16_t)(0x2c00 + (k + i) * 2654435761u % 4096);
        struct ls_store_picture picture = {
            .condition = ids[i], .mosaic = {.width = s->side, .height = s->side, .half = half}};
        must(!ls_store_publish(store, &picture, NULL), "a picture cannot be written");
    }
    free(half);
}

static void make_take(struct serving *s)
{
    struct ls_store *store = NULL;
    struct ls_diag diag = {{0}};
    char **ids = g_new0(char *, s->n_lights + 3);
    for (uint32_t i = 0; i < s->n_lights; i++)
        ids[i] = g_strdup_printf("W-%04u", i);
    ids[s->n_lights] = g_strdup("sphere-W");
    ids[s->n_lights + 1] = g_strdup("sphere-R");
    char *json = json_of(s, ids);
    const struct ls_store_config config = {.root = s->stage.storage,
                                           .name = "bench",
                                           .take_json = json,
                                           .utc_s = 1767323045,
                                           .n_cameras = 1,
                                           .n_shots = s->n_lights + 2,
                                           .conditions = (const char *const *)ids,
                                           .n_conditions = s->n_lights + 2,
                                           .need_bytes = 1 << 20};
    must(!ls_store_create(&config, &store, &diag), diag.text);
    publish_all(s, store, ids);
    s->id = g_strdup(ls_store_id(store));
    must(!ls_store_close(store, &diag), diag.text);
    g_free(json);
    g_strfreev(ids);
}

char *serving_picture(const struct serving *s, uint32_t light)
{
    return g_strdup_printf("%s/%s/cam0/W-%04u.exr", s->stage.storage, s->id, light);
}

struct iovec *serving_spans(const struct serving *s, size_t *n)
{
    uint32_t across = (s->side + 63) / 64;
    struct iovec *spans = g_new(struct iovec, (size_t)across * across * s->n_lights);
    *n = 0;
    for (uint32_t i = 0; i < s->n_lights; i++) {
        struct ls_picture_map *map = bench_alloc(sizeof *map);
        struct ls_diag diag = {{0}};
        char *path = serving_picture(s, i);
        must(!ls_picture_map_open(map, "/", path, s->side, s->side, &diag), diag.text);
        for (uint32_t t = 0; t < across * across; t++)
            spans[(*n)++] = (struct iovec){(void *)map->tiles.tile[t], 2 * 64 * 64};
        g_free(path);
    }
    return spans;
}

void serving_make(struct serving *s, uint32_t n_lights, uint32_t side, unsigned clients)
{
    ls_give_way(); /* as who serves does: here clients share its processors */
    *s = (struct serving){.n_lights = n_lights, .side = side};
    stage_init(&s->stage);
    s->stage.limits.max_connections = clients;
    make_take(s);
}

void serving_start(struct serving *s)
{
    stage_open(&s->stage);
}

void serving_open(struct serving *s, uint32_t n_lights, uint32_t side, unsigned clients)
{
    serving_make(s, n_lights, side, clients);
    serving_start(s);
}

void serving_close(struct serving *s)
{
    stage_close(&s->stage);
    g_free(s->id);
}

/* ---- clients ---- */

void receive_bytes(int fd, void *bytes, size_t n)
{
    for (size_t got = 0; got < n;) {
        ssize_t k = recv(fd, (char *)bytes + got, n - got, 0);
        must(k > 0 || (k < 0 && errno == EINTR), "the connection has ended");
        got += k > 0 ? (size_t)k : 0;
    }
}

/* The head of a frame, and what descriptor comes with it. */
static void receive_head(struct receiver *r, uint8_t *head, size_t n)
{
    char control[CMSG_SPACE(sizeof(int))];
    struct iovec span = {head, n};
    struct msghdr message = {.msg_iov = &span,
                             .msg_iovlen = 1,
                             .msg_control = control,
                             .msg_controllen = sizeof control};
    ssize_t got = recvmsg(r->fd, &message, MSG_CMSG_CLOEXEC);
    must(got > 0, "the connection has ended");
    r->passed = -1;
    if (CMSG_FIRSTHDR(&message))
        memcpy(&r->passed, CMSG_DATA(CMSG_FIRSTHDR(&message)), sizeof r->passed);
    receive_bytes(r->fd, head + got, n - (size_t)got);
}

static void need(struct receiver *r, size_t n)
{
    if (n <= r->capacity)
        return;
    free(r->bytes);
    r->capacity = n;
    r->bytes = bench_alloc(n);
}

/* One frame; its header. */
static struct ls_frame_header receive(struct receiver *r)
{
    uint8_t head[LS_FRAME_HEADER_BYTES], message[LS_FRAME_MAX_MESSAGE];
    struct ls_frame_header header;
    receive_head(r, head, sizeof head);
    must(!ls_frame_get(head, UINT32_MAX, &header, NULL), "not a frame");
    receive_bytes(r->fd, message, header.message_bytes);
    must(header.type != LS_MESSAGE_ERROR, "refused by the daemon");
    need(r, header.payload_bytes);
    receive_bytes(r->fd, r->bytes, header.payload_bytes);
    r->received += header.payload_bytes;
    return header;
}

static void ask(struct receiver *r, uint16_t type, const ProtobufCMessage *body)
{
    uint8_t *bytes = NULL;
    size_t n = 0;
    must(!ls_message_frame(type, ++r->request, LS_FRAME_LAST, body, 0, &bytes, &n, NULL),
         "no memory for a request");
    must(send(r->fd, bytes, n, MSG_NOSIGNAL) == (ssize_t)n, "the request cannot be sent");
    free(bytes);
}

static void unmap(gpointer data)
{
    struct iovec *span = data;
    munmap(span->iov_base, span->iov_len);
    g_free(span);
}

void receiver_open(struct receiver *r, const struct serving *s)
{
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    *r = (struct receiver){.fd = a_bare_socket((struct stage *)&s->stage)};
    r->mapped = g_hash_table_new_full(NULL, NULL, NULL, unmap);
    hello.version = LS_FRAME_VERSION;
    hello.client = (char *)"bench";
    ask(r, LS_MESSAGE_HELLO, &hello.base);
    receive(r);
}

void receiver_close(struct receiver *r)
{
    close(r->fd);
    g_hash_table_unref(r->mapped);
    free(r->bytes);
}

void receive_all(struct receiver *r, const Lightstage__Fetch *fetch)
{
    struct ls_frame_header header;
    ask(r, LS_MESSAGE_FETCH, &fetch->base);
    do
        header = receive(r);
    while (!(header.flags & LS_FRAME_LAST));
}

static struct iovec *map_passed(const struct receiver *r, const struct stat *info)
{
    struct iovec *span = g_new(struct iovec, 1);
    span->iov_len = (size_t)info->st_size;
    span->iov_base = mmap(NULL, span->iov_len, PROT_READ, MAP_SHARED | MAP_POPULATE, r->passed, 0);
    must(span->iov_base != MAP_FAILED, "a memfd cannot be mapped");
    return span;
}

static uint64_t read_passed(struct receiver *r, bool keep)
{
    struct stat info;
    must(r->passed >= 0 && fstat(r->passed, &info) == 0, "no memfd came");
    gpointer key = GSIZE_TO_POINTER(info.st_ino);
    struct iovec *span = keep ? g_hash_table_lookup(r->mapped, key) : NULL;
    bool known = span != NULL;
    if (!known)
        span = map_passed(r, &info);
    struct reference_bytes all = {.from = span->iov_base, .bytes = span->iov_len, .n_threads = 1};
    reference_read(&all);
    close(r->passed);
    if (!keep)
        unmap(span);
    else if (!known)
        g_hash_table_insert(r->mapped, key, span);
    return all.sum;
}

uint64_t read_memfds(struct receiver *r, const Lightstage__Fetch *fetch, bool keep)
{
    struct ls_frame_header header;
    uint64_t sum = 0;
    ask(r, LS_MESSAGE_FETCH, &fetch->base);
    do {
        header = receive(r);
        sum += read_passed(r, keep);
    } while (!(header.flags & LS_FRAME_LAST));
    return sum;
}

void stored_fetch(Lightstage__Fetch *fetch, const struct serving *s)
{
    lightstage__fetch__init(fetch);
    fetch->take = s->id;
    fetch->channel = (char *)"W";
    fetch->quantity = LIGHTSTAGE__QUANTITY__ESTIMATE;
    fetch->sample = LIGHTSTAGE__SAMPLE__HALF;
    fetch->tiles = true;
}

void promoted_fetch(Lightstage__Fetch *fetch, const struct serving *s)
{
    stored_fetch(fetch, s);
    fetch->channel = (char *)"R";
    fetch->model = LIGHTSTAGE__MODEL__SPHERE;
    fetch->layout = LIGHTSTAGE__LAYOUT__RGB;
    fetch->quantity = LIGHTSTAGE__QUANTITY__REFLECTANCE;
}
