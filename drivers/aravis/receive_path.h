/*
 * receive_path: how packets of a stream reach this process, found out rather than assumed.
 * Layer: drivers. Threads: any; not RT-safe. Ownership: none.
 *
 * With CAP_NET_RAW Aravis reads a packet socket, which its receive thread sets up on its own
 * time: mapping the ring takes up to 100 ms, and what the camera sends before that is lost. The
 * socket is ours too, so it can be seen: bound to an interface, with a filter for the stream's
 * port. Without the capability Aravis silently reads UDP.
 */
#ifndef LS_DRIVERS_ARAVIS_RECEIVE_PATH_H
#define LS_DRIVERS_ARAVIS_RECEIVE_PATH_H

#include "drivers/camera.h"

#include <arv.h>

/** Say in @info which path a stream with these options takes: the same decision as Aravis'. */
void ls_aravis_describe_receive_path(ArvGvStreamOption options, struct ls_camera_info *info);

/** Wait for the packet socket that receives UDP port @port, at most 2 s. LS_ERR_OS: a packet
 * socket is allowed, yet none appeared. */
LS_MUST_CHECK enum ls_err ls_aravis_wait_receive_path(const char *address, uint16_t port,
                                                      struct ls_diag *diag);

#endif
