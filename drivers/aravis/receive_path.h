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

/** Wait until packets to UDP port @port are received, at most 2 s, and say by which path in
 * @info. LS_ERR_OS: a packet socket is allowed, yet none appeared. */
LS_MUST_CHECK enum ls_err ls_aravis_receive_path(const char *address, uint16_t port,
                                                 struct ls_camera_info *info,
                                                 struct ls_diag *diag);

#endif
