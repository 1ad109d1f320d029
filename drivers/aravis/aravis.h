/*
 * aravis: the GigE Vision camera driver, over Aravis 0.8.
 * Layer: drivers. Threads, ownership: those of drivers/camera.h. Two more threads come with
 * Aravis: one receives packets into the caller's slots (at rt_priority), one sends heartbeats.
 *
 * The packet socket of Aravis needs CAP_NET_RAW; without it Aravis silently reads UDP, which at
 * 300 MB/s needs 32 MiB in net.core.rmem_max and rmem_default: info says which path is in use and
 * what the kernel grants.
 *
 * A camera that falls silent or starts afresh while it streams is gone after at most 2.4 s
 * (watch.h): `next` says LS_ERR_GONE, and so does every register access. Stop and close do not wait
 * for such a camera; threads of their own take leave of it, and meanwhile, some seconds, it may say
 * LS_ERR_BUSY to who opens it again. Before it streams, a register access to a silent camera takes
 * 3 s.
 */
#ifndef LS_DRIVERS_ARAVIS_H
#define LS_DRIVERS_ARAVIS_H

#include "drivers/camera.h"

extern const struct ls_camera_ops ls_aravis_ops;

#endif
