/*
 * profile: constants that belong to one camera and one mirror ball, under a name.
 * Layer: core. Threads: any, read-only.
 *
 * Nothing uses them unless somebody names the profile: a matrix of another camera is worse than
 * none.
 */
#ifndef LS_CORE_PROFILE_H
#define LS_CORE_PROFILE_H

struct ls_profile {
    const char *name;
    double m[3][3];              /* camera-raw to linear Rec. 709, white balance in it */
    double ball_reflectivity[3]; /* R, G, B of the mirror ball */
    double mono_mix[3];          /* R, G, B of the camera that add up to its monochrome sister */
};

/** "paper": LeGendre, Yu and Debevec, Ximea MQ042CG-CM and their mirror ball, as they publish them.
 * NULL: no such name. RT-safe. */
const struct ls_profile *ls_profile_find(const char *name);

#endif
