/*
 * view: how a camera stands in the stage.
 * Layer: core. Threads: any. Ownership: everything is the caller's.
 */
#ifndef LS_CORE_VIEW_H
#define LS_CORE_VIEW_H

/**
 * World (stage frame, metres) to camera (x right, y up, looking along -z), for row vectors:
 * p_camera = p_world M, as OpenEXR's worldToCamera has it. Looking straight up or down, the
 * picture's top points to -z. RT-safe.
 */
void ls_world_to_camera(const float position_m[3], const float look_at_m[3], float matrix[16]);

#endif
