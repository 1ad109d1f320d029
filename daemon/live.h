/*
 * live: pictures of what cameras see, to the sessions that look.
 * Layer: daemon. Threads: ls-main. Ownership: none; a timer runs while somebody looks.
 */
#ifndef LS_DAEMON_LIVE_H
#define LS_DAEMON_LIVE_H

#include "daemon/service.h"

/** Ten times a second from now on, as long as a session looks: send what there is to those who
 * have room for it, want the next for them, and tell whose live view has ended. */
void ls_live_begin(struct ls_service *service);

/** Once, now. */
void ls_live_look(struct ls_service *service);

/** No more; at the server's end. */
void ls_live_end(struct ls_service *service);

#endif
