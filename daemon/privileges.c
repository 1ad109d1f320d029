#include "daemon/privileges.h"

#include <linux/capability.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { LOCKED_BYTES_WANTED = 1 << 30 }; /* a few rings of 32 frames */

static bool capable(unsigned cap)
{
    struct __user_cap_header_struct header = {.version = _LINUX_CAPABILITY_VERSION_3};
    struct __user_cap_data_struct data[2];
    if (syscall(SYS_capget, &header, data))
        return false;
    return data[cap / 32].effective & (1u << (cap % 32));
}

static rlim_t limit(int resource)
{
    struct rlimit r;
    return getrlimit(resource, &r) ? 0 : r.rlim_cur;
}

static void add(char *text, size_t size, const char *what)
{
    size_t used = strlen(text);
    snprintf(text + used, size - used, "%s%s", used ? "; " : "", what);
}

void ls_privileges_missing(char *text, size_t size)
{
    text[0] = 0;
    if (!capable(CAP_NET_RAW))
        add(text, size, "CAP_NET_RAW (frames through a packet socket, a third of the CPU)");
    if (!capable(CAP_SYS_NICE) && !limit(RLIMIT_RTPRIO))
        add(text, size, "CAP_SYS_NICE (real-time threads)");
    if (!capable(CAP_IPC_LOCK) && limit(RLIMIT_MEMLOCK) < LOCKED_BYTES_WANTED)
        add(text, size, "CAP_IPC_LOCK (frame ring locked in memory)");
}
