/*
 * receive_path: how packets of a stream reach this process, found out rather than assumed.
 * Layer: drivers. Threads: any; not RT-safe. Ownership: none.
 *
 * With CAP_NET_RAW Aravis reads a packet socket, which its receive thread sets up on its own
 * time: mapping the ring takes up to 100 ms, and what the camera sends before that is lost. The
 * socket is ours too, so it can be seen: bound to an interface, with a filter for the stream's
 * port. Without the capability Aravis silently reads UDP, from a socket whose buffer it leaves at
 * the kernel's default until frames come: a reader late by a few frames then loses packets.
 */
#ifndef LS_DRIVERS_ARAVIS_RECEIVE_PATH_H
#define LS_DRIVERS_ARAVIS_RECEIVE_PATH_H

#include "drivers/camera.h"

#include <arv.h>

enum { LS_ARAVIS_RECEIVE_BUFFER = 32 << 20 }; /* bytes wanted of a UDP socket */

/** May this process receive by packet sockets? Aravis decides by the same attempt. */
bool ls_aravis_packet_sockets_allowed(void);

/** Say in @info which path a stream of UDP port @port with these options takes, by the same
 * decision as Aravis', and give a UDP socket its buffer. */
void ls_aravis_prepare_receive_path(ArvGvStreamOption options, uint16_t port,
                                    struct ls_camera_info *info);

/** Wait for the packet socket that receives UDP port @port, at most 2 s. LS_ERR_OS: a packet
 * socket is allowed, yet none appeared. */
LS_MUST_CHECK enum ls_err ls_aravis_wait_receive_path(const char *address, uint16_t port,
                                                      struct ls_diag *diag);

#endif
