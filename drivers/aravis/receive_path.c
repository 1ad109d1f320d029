#include "drivers/aravis/receive_path.h"

#include <arpa/inet.h>
#include <dirent.h>
#include <linux/filter.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum {
    WANTED_BUFFER = 32 << 20,
    MAX_FILTER = 64,
    WAIT_MS = 2000,
};

static uint32_t sysctl_bytes(const char *path)
{
    unsigned long value = 0;
    FILE *file = fopen(path, "re");
    if (!file)
        return 0;
    if (fscanf(file, "%lu", &value) != 1)
        value = 0;
    fclose(file);
    return value > WANTED_BUFFER ? WANTED_BUFFER : (uint32_t)value;
}

/** Aravis decides by the same attempt. */
static bool packet_sockets_allowed(void)
{
    int fd = socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0);
    if (fd >= 0)
        close(fd);
    return fd >= 0;
}

static bool is_bound_packet_socket(int fd)
{
    int domain = 0;
    struct sockaddr_ll at = {0};
    socklen_t size = sizeof domain;
    if (getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &size) || domain != AF_PACKET)
        return false;
    size = sizeof at;
    return getsockname(fd, (struct sockaddr *)&at, &size) == 0 && at.sll_ifindex != 0;
}

static bool filters_port(int fd, uint16_t port)
{
    struct sock_filter filter[MAX_FILTER];
    socklen_t n = MAX_FILTER; /* this option counts instructions, not bytes */
    if (getsockopt(fd, SOL_SOCKET, SO_GET_FILTER, filter, &n))
        return false;
    for (socklen_t i = 0; i < n && i < MAX_FILTER; i++)
        if (BPF_CLASS(filter[i].code) == BPF_JMP && filter[i].k == port)
            return true;
    return false;
}

static bool receives(uint16_t port)
{
    bool found = false;
    DIR *fds = opendir("/proc/self/fd");
    if (!fds)
        return false;
    for (struct dirent *entry = readdir(fds); entry && !found; entry = readdir(fds)) {
        int fd = atoi(entry->d_name);
        found = is_bound_packet_socket(fd) && filters_port(fd, port);
    }
    closedir(fds);
    return found;
}

void ls_aravis_describe_receive_path(ArvGvStreamOption options, struct ls_camera_info *info)
{
    uint32_t max = sysctl_bytes("/proc/sys/net/core/rmem_max");
    uint32_t initial = sysctl_bytes("/proc/sys/net/core/rmem_default");
    info->packet_socket =
        !(options & ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED) && packet_sockets_allowed();
    info->receive_buffer_bytes = info->packet_socket ? 0 : initial < max ? initial : max;
}

enum ls_err ls_aravis_wait_receive_path(const char *address, uint16_t port, struct ls_diag *diag)
{
    /* neither Aravis nor the kernel tells when a filter is attached: look each millisecond */
    for (int ms = 0; ms < WAIT_MS; ms++) {
        if (receives(port))
            return LS_OK;
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    }
    return ls_fail(diag, LS_ERR_OS, "camera %s: no packet socket listens for port %u after %d ms",
                   address, port, WAIT_MS);
}
