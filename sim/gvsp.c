#include "sim/gvsp.h"

#include "sim/draw.h"
#include "sim/gvcp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum packet_type { LEADER = 1, TRAILER = 2, PAYLOAD = 3 };

enum {
    RING = 6,
    BATCH = 64,
    OVERHEAD = 36, /* IP, UDP and GVSP headers */
    UDP_OVERHEAD = 28,
    HEADER_BYTES = 8,
    LEADER_BYTES = 36,
    TRAILER_BYTES = 8,
    PAYLOAD_IMAGE = 0x0001,
    PAYLOAD_IMAGE_CHUNKS = 0x4001,
    SEND_BUFFER = 8 << 20,
    SLICE_NS = 200000, /* packets with a delay leave together for so long */
};

struct slot {
    struct sim_gvsp_frame frame; /* first member */
    size_t capacity;
    bool kept; /* may be resent */
};

struct sim_gvsp {
    int socket;
    uint16_t port;
    double loss;
    uint64_t seed;
    pthread_mutex_t lock; /* of slots, between the exposing and the resending thread */
    struct slot ring[RING];
    unsigned next;
    atomic_uint_fast64_t drawn, lost, resent, refused, errors;
};

/** Packets on their way to one sendmmsg. */
struct batch {
    struct sim_gvsp *gvsp;
    struct sockaddr_in to;
    uint32_t delay_ns;
    unsigned n, most;
    struct mmsghdr messages[BATCH];
    struct iovec parts[BATCH][2];
    uint8_t heads[BATCH][HEADER_BYTES + LEADER_BYTES];
};

static bool loses(struct sim_gvsp *g)
{
    return g->loss > 0 && sim_draw(g->seed, atomic_fetch_add(&g->drawn, 1) + 1) < g->loss;
}

static void write_header(uint8_t *head, enum sim_gvcp_status status, uint16_t block,
                         enum packet_type type, uint32_t packet)
{
    sim_gev_store16(head, status);
    sim_gev_store16(head + 2, block);
    sim_gev_store32(head + 4, (uint32_t)type << 24 | packet);
}

static void write_leader(uint8_t *body, const struct sim_gvsp_frame *f)
{
    memset(body, 0, LEADER_BYTES);
    sim_gev_store16(body + 2, f->chunks ? PAYLOAD_IMAGE_CHUNKS : PAYLOAD_IMAGE);
    sim_gev_store32(body + 4, (uint32_t)(f->ticks >> 32));
    sim_gev_store32(body + 8, (uint32_t)f->ticks);
    sim_gev_store32(body + 12, f->format.pixel_format);
    sim_gev_store32(body + 16, f->format.width);
    sim_gev_store32(body + 20, f->format.height);
    sim_gev_store32(body + 24, f->format.offset_x);
    sim_gev_store32(body + 28, f->format.offset_y);
}

static void write_trailer(uint8_t *body, const struct sim_gvsp_frame *f)
{
    sim_gev_store32(body, f->chunks ? PAYLOAD_IMAGE_CHUNKS : PAYLOAD_IMAGE);
    sim_gev_store32(body + 4, f->format.height);
}

static void pause_for(uint64_t ns)
{
    struct timespec rest = {(time_t)(ns / 1000000000u), (long)(ns % 1000000000u)};
    while (nanosleep(&rest, &rest) && errno == EINTR)
        continue;
}

static void flush(struct batch *b)
{
    for (unsigned sent = 0; sent < b->n;) {
        int n = sendmmsg(b->gvsp->socket, b->messages + sent, b->n - sent, 0);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            atomic_fetch_add(&b->gvsp->errors, 1);
        sent += n < 0 ? 1 : (unsigned)n;
    }
    if (b->delay_ns)
        pause_for((uint64_t)b->delay_ns * b->n);
    b->n = 0;
}

static void add(struct batch *b, const struct sim_gvsp_frame *f, uint32_t packet)
{
    if (loses(b->gvsp)) {
        atomic_fetch_add(&b->gvsp->lost, 1);
        return;
    }
    uint8_t *head = b->heads[b->n];
    struct iovec *part = b->parts[b->n];
    bool leader = packet == 0, trailer = packet == f->n_payload_packets + 1;
    uint32_t room = f->packet_size - OVERHEAD, at = (packet - 1) * room;
    write_header(head, SIM_GVCP_OK, f->block,
                 leader    ? LEADER
                 : trailer ? TRAILER
                           : PAYLOAD,
                 packet);
    part[0] = (struct iovec){head, HEADER_BYTES};
    part[1] = (struct iovec){NULL, 0};
    if (leader) {
        write_leader(head + HEADER_BYTES, f);
        part[0].iov_len += LEADER_BYTES;
    } else if (trailer) {
        write_trailer(head + HEADER_BYTES, f);
        part[0].iov_len += TRAILER_BYTES;
    } else {
        uint32_t left = f->payload_bytes - at;
        part[1] = (struct iovec){f->payload + at, left < room ? left : room};
    }
    b->messages[b->n].msg_hdr = (struct msghdr){
        .msg_name = &b->to, .msg_namelen = sizeof b->to, .msg_iov = part, .msg_iovlen = 2};
    if (++b->n == b->most)
        flush(b);
}

static void send_range(struct sim_gvsp *g, const struct sim_gvsp_frame *f, uint32_t first,
                       uint32_t last)
{
    struct batch b;
    b.gvsp = g;
    b.n = 0;
    b.delay_ns = f->packet_delay_ns;
    b.most = b.delay_ns ? SLICE_NS / b.delay_ns : BATCH;
    b.most = b.most < 1 ? 1 : b.most > BATCH ? BATCH : b.most;
    b.to = (struct sockaddr_in){.sin_family = AF_INET,
                                .sin_port = htons((uint16_t)f->port),
                                .sin_addr.s_addr = htonl(f->address)};
    if (!f->port)
        return;
    for (uint32_t packet = first; packet <= last; packet++)
        add(&b, f, packet);
    flush(&b);
}

static void send_alone(struct sim_gvsp *g, const struct sim_camera_settings *settings,
                       const void *data, size_t n)
{
    struct sockaddr_in to = {.sin_family = AF_INET,
                             .sin_port = htons((uint16_t)settings->stream_port),
                             .sin_addr.s_addr = htonl(settings->stream_address)};
    if (settings->stream_port &&
        sendto(g->socket, data, n, 0, (struct sockaddr *)&to, sizeof to) < 0)
        atomic_fetch_add(&g->errors, 1);
}

struct sim_gvsp_frame *sim_gvsp_begin(struct sim_gvsp *g,
                                      const struct sim_camera_settings *settings)
{
    pthread_mutex_lock(&g->lock);
    struct slot *slot = &g->ring[g->next++ % RING];
    slot->kept = false;
    pthread_mutex_unlock(&g->lock);
    if (slot->capacity < settings->payload_bytes) {
        free(slot->frame.payload);
        slot->frame.payload = malloc(settings->payload_bytes);
        slot->capacity = slot->frame.payload ? settings->payload_bytes : 0;
        if (!slot->frame.payload)
            return NULL;
    }
    uint8_t *payload = slot->frame.payload;
    uint32_t room = settings->packet_size - OVERHEAD;
    slot->frame = (struct sim_gvsp_frame){
        .chunks = settings->chunks,
        .format = settings->format,
        .address = settings->stream_address,
        .port = settings->stream_port,
        .packet_size = settings->packet_size,
        .packet_delay_ns = settings->packet_delay_ns,
        .payload_bytes = settings->payload_bytes,
        .n_payload_packets = (settings->payload_bytes + room - 1) / room,
        .payload = payload,
    };
    return &slot->frame;
}

void sim_gvsp_send(struct sim_gvsp *g, struct sim_gvsp_frame *frame, uint16_t block, uint64_t ticks,
                   bool leader)
{
    struct slot *slot = (struct slot *)frame;
    pthread_mutex_lock(&g->lock);
    frame->block = block;
    frame->ticks = ticks;
    slot->kept = true;
    pthread_mutex_unlock(&g->lock);
    send_range(g, frame, leader ? 0 : 1, frame->n_payload_packets + 1);
}

void sim_gvsp_repeat(struct sim_gvsp *g, const struct sim_gvsp_frame *frame)
{
    send_range(g, frame, 0, frame->n_payload_packets + 1);
}

static const struct slot *find(const struct sim_gvsp *g, uint16_t block)
{
    for (unsigned i = 0; i < RING; i++)
        if (g->ring[i].kept && g->ring[i].frame.block == block)
            return &g->ring[i];
    return NULL;
}

static void refuse(struct sim_gvsp *g, const struct sim_camera_settings *settings, uint16_t block,
                   uint32_t packet)
{
    uint8_t head[HEADER_BYTES];
    write_header(head, SIM_GVCP_PACKET_UNAVAILABLE, block, PAYLOAD, packet);
    send_alone(g, settings, head, sizeof head);
    atomic_fetch_add(&g->refused, 1);
}

void sim_gvsp_resend(struct sim_gvsp *g, const struct sim_camera_settings *settings, uint16_t block,
                     uint32_t first, uint32_t last)
{
    pthread_mutex_lock(&g->lock);
    const struct slot *slot = find(g, block);
    if (slot && first <= last && last <= slot->frame.n_payload_packets + 1) {
        atomic_fetch_add(&g->resent, last - first + 1);
        send_range(g, &slot->frame, first, last);
    } else {
        refuse(g, settings, block, first);
    }
    pthread_mutex_unlock(&g->lock);
}

void sim_gvsp_test_packet(struct sim_gvsp *g, const struct sim_camera_settings *settings)
{
    uint8_t *packet = calloc(1, settings->packet_size);
    if (packet)
        send_alone(g, settings, packet, settings->packet_size - UDP_OVERHEAD);
    free(packet);
}

void sim_gvsp_forget(struct sim_gvsp *g)
{
    pthread_mutex_lock(&g->lock);
    for (unsigned i = 0; i < RING; i++)
        g->ring[i].kept = false;
    pthread_mutex_unlock(&g->lock);
}

uint16_t sim_gvsp_source_port(const struct sim_gvsp *g)
{
    return g->port;
}

void sim_gvsp_stats(struct sim_gvsp *g, struct sim_gvsp_stats *stats)
{
    *stats = (struct sim_gvsp_stats){atomic_load(&g->lost), atomic_load(&g->resent),
                                     atomic_load(&g->refused), atomic_load(&g->errors)};
}

static int stream_socket(uint32_t ip_address, uint16_t *port)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(ip_address)};
    socklen_t size = sizeof at;
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), buffer = SEND_BUFFER;
    if (fd < 0)
        return -1;
    if (setsockopt(fd, SOL_SOCKET, SO_SNDBUFFORCE, &buffer, sizeof buffer))
        setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &buffer, sizeof buffer);
    if (bind(fd, (struct sockaddr *)&at, size) || getsockname(fd, (struct sockaddr *)&at, &size)) {
        close(fd);
        return -1;
    }
    *port = ntohs(at.sin_port);
    return fd;
}

enum ls_err sim_gvsp_create(uint32_t ip_address, double loss, uint64_t seed, struct sim_gvsp **out,
                            struct ls_diag *diag)
{
    struct sim_gvsp *g = calloc(1, sizeof *g);
    if (!g)
        return LS_ERR_NOMEM;
    g->loss = loss;
    g->seed = seed;
    g->socket = stream_socket(ip_address, &g->port);
    if (g->socket < 0) {
        free(g);
        return ls_fail(diag, LS_ERR_OS, "camera: cannot open its stream socket: %s",
                       strerror(errno));
    }
    pthread_mutex_init(&g->lock, NULL);
    *out = g;
    return LS_OK;
}

void sim_gvsp_destroy(struct sim_gvsp *g)
{
    if (!g)
        return;
    for (unsigned i = 0; i < RING; i++)
        free(g->ring[i].frame.payload);
    close(g->socket);
    pthread_mutex_destroy(&g->lock);
    free(g);
}
