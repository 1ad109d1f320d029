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
    MAX_FILTER = 64,
    WAIT_MS = 2000,
};

bool ls_aravis_packet_sockets_allowed(void)
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

static bool is_packet_socket_of(int fd, uint16_t port)
{
    return is_bound_packet_socket(fd) && filters_port(fd, port);
}

static bool is_udp_socket_of(int fd, uint16_t port)
{
    int type = 0;
    struct sockaddr_in at = {0};
    socklen_t size = sizeof type;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) || type != SOCK_DGRAM)
        return false;
    size = sizeof at;
    return getsockname(fd, (struct sockaddr *)&at, &size) == 0 && at.sin_family == AF_INET &&
           ntohs(at.sin_port) == port;
}

/** The descriptor of this process that is the socket wanted, or -1. */
static int find_socket(bool (*wanted)(int fd, uint16_t port), uint16_t port)
{
    int found = -1;
    DIR *fds = opendir("/proc/self/fd");
    if (!fds)
        return -1;
    for (struct dirent *entry = readdir(fds); entry && found < 0; entry = readdir(fds)) {
        int fd = atoi(entry->d_name);
        if (wanted(fd, port))
            found = fd;
    }
    closedir(fds);
    return found;
}

/** As much as the kernel grants, now: Aravis asks for it when it has taken in a first packet, and
 * the default holds 70 of 1500 bytes. The kernel counts its own bookkeeping as much again. */
static uint32_t widen_buffer(uint16_t port)
{
    int fd = find_socket(is_udp_socket_of, port), bytes = LS_ARAVIS_RECEIVE_BUFFER;
    socklen_t size = sizeof bytes;
    if (fd < 0)
        return 0;
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
    return getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &bytes, &size) ? 0 : (uint32_t)bytes / 2;
}

void ls_aravis_prepare_receive_path(ArvGvStreamOption options, uint16_t port,
                                    struct ls_camera_info *info)
{
    info->packet_socket = !(options & ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED) &&
                          ls_aravis_packet_sockets_allowed();
    info->receive_buffer_bytes = info->packet_socket ? 0 : widen_buffer(port);
}

enum ls_err ls_aravis_wait_receive_path(const char *address, uint16_t port, struct ls_diag *diag)
{
    /* neither Aravis nor the kernel tells when a filter is attached: look each millisecond */
    for (int ms = 0; ms < WAIT_MS; ms++) {
        if (find_socket(is_packet_socket_of, port) >= 0)
            return LS_OK;
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    }
    return ls_fail(diag, LS_ERR_OS, "camera %s: no packet socket listens for port %u after %d ms",
                   address, port, WAIT_MS);
}
