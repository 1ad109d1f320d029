/*
 * gvsp: the stream channel of a simulated camera: cuts frames into packets, keeps the last few
 * for resend requests, loses packets on demand (GigE Vision stream protocol over UDP).
 * Layer: sim. Threads: frames are begun, sent and abandoned on one thread; resend, test packet and
 * stats on any other. Ownership: owns its socket and its ring; a begun frame is the caller's to
 * fill until it is sent or abandoned.
 *
 * A block is a leader (packet 0), payload packets 1..n and a trailer (n + 1). Each packet carries
 * packet_size - 36 bytes of payload: IP 20, UDP 8 and GVSP 8 bytes are counted in the size.
 */
#ifndef LS_SIM_GVSP_H
#define LS_SIM_GVSP_H

#include "sim/camera_registers.h"

/** A frame in the ring. */
struct sim_gvsp_frame {
    uint16_t block;
    bool chunks;
    uint64_t ticks;
    struct sim_raw_format format;
    uint32_t address, port, packet_size, packet_delay_ns;
    uint32_t payload_bytes, n_payload_packets;
    uint8_t *payload; /* payload_bytes of them */
};

struct sim_gvsp_stats {
    uint64_t packets_lost, packets_resent, resends_refused, send_errors;
};

struct sim_gvsp;

/** @loss: probability of losing a packet, drawn from @seed. (transfer full). */
LS_MUST_CHECK enum ls_err sim_gvsp_create(uint32_t ip_address, double loss, uint64_t seed,
                                          struct sim_gvsp **out, struct ls_diag *diag);

/** UDP port packets come from. */
uint16_t sim_gvsp_source_port(const struct sim_gvsp *gvsp);

/** The next free frame of the ring, with room for @settings' payload; what it held can no longer
 * be resent. NULL if there is no memory. (transfer none). */
struct sim_gvsp_frame *sim_gvsp_begin(struct sim_gvsp *gvsp,
                                      const struct sim_camera_settings *settings);

/** Send a begun frame as @block with timestamp @ticks; from now on it can be resent. Without its
 * @leader that packet is lost on the way. */
void sim_gvsp_send(struct sim_gvsp *gvsp, struct sim_gvsp_frame *frame, uint16_t block,
                   uint64_t ticks, bool leader);

/** Send a sent frame once more, whole. */
void sim_gvsp_repeat(struct sim_gvsp *gvsp, const struct sim_gvsp_frame *frame);

/** Resend packets [first, last]; what is gone is refused by a status packet to the stream
 * destination of @settings. */
void sim_gvsp_resend(struct sim_gvsp *gvsp, const struct sim_camera_settings *settings,
                     uint16_t block, uint32_t first, uint32_t last);

/** One packet of the negotiated size, so that the host can try the path. */
void sim_gvsp_test_packet(struct sim_gvsp *gvsp, const struct sim_camera_settings *settings);

/** Forget every frame: none can be resent. */
void sim_gvsp_forget(struct sim_gvsp *gvsp);

void sim_gvsp_stats(struct sim_gvsp *gvsp, struct sim_gvsp_stats *stats);

/** NULL is allowed. */
void sim_gvsp_destroy(struct sim_gvsp *gvsp);

#endif
