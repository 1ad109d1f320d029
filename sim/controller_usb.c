/* The controller as a USB device, by the kernel's usbfs interface: umockdev hands us the ioctls of
 * a process that runs under its preload library, whose libusb and libudev are the real ones. */
#include "sim/controller_private.h"
#include "sim/usb_device.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/usbdevice_fs.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <umockdev.h>
#include <unistd.h>

/** A transfer of the host: a copy of its struct and of its buffer. */
struct urb {
    UMockdevIoctlData *data, *buffer; /* buffer NULL: none */
    unsigned long address;            /* the host's */
    const UMockdevIoctlClient *owner; /* whoever opened the node and submitted it */
};

struct usb {
    UMockdevTestbed *testbed;
    UMockdevIoctlBase *ioctls;
    gulong handler, vanished;
    int device_number;
    bool plugged;
    char syspath[64], node[64]; /* of this plugging */
    int ready;                  /* descriptor the host polls, see make_pollable */
    /* under the controller's lock */
    GQueue waiting, done;               /* struct urb */
    const UMockdevIoctlClient *claimer; /* has the interface; NULL: nobody */
    bool halted;                        /* the event endpoint */
    uint32_t next_event;                /* to be sent */
    uint32_t boot;                      /* of it, as the arm */
    uint16_t arm;
    uint16_t packets;
};

static struct usbdevfs_urb *usbdevfs(const struct urb *urb)
{
    return (struct usbdevfs_urb *)urb->data->data;
}

static void urb_free(void *data)
{
    struct urb *urb = data;
    if (urb->buffer)
        g_object_unref(urb->buffer);
    g_object_unref(urb->data);
    g_free(urb);
}

/** A usbfs node is writable when a transfer has come back. A file always is, so the node is a
 * FIFO: full while there is nothing to fetch. */
static void set_ready(struct usb *usb, bool ready)
{
    char page[4096] = {0};
    if (ready)
        while (read(usb->ready, page, sizeof page) > 0)
            ;
    else
        while (write(usb->ready, page, sizeof page) > 0)
            ;
}

static void give_back(struct usb *usb, struct urb *urb, int status, int length)
{
    usbdevfs(urb)->status = status;
    usbdevfs(urb)->actual_length = length;
    g_queue_push_tail(&usb->done, urb);
    set_ready(usb, true);
}

/* ---- what the device does; all of it under the controller's lock ---- */

static void control(struct sim_controller *c, struct usb *usb, struct urb *urb)
{
    int status = 0;
    int n = sim_usb_control(c, urb->buffer->data, usbdevfs(urb)->buffer_length, &status);
    give_back(usb, urb, status, n);
}

static struct urb *waiting_for_events(struct usb *usb)
{
    for (GList *link = usb->waiting.head; link; link = link->next)
        if (usbdevfs(link->data)->endpoint == LS_WIRE_USB_EVENTS)
            return link->data;
    return NULL;
}

static void send_packet(struct sim_controller *c, struct usb *usb, struct urb *urb)
{
    uint8_t bytes[LS_WIRE_USB_PACKET_BYTES];
    uint32_t first = usb->next_event;
    size_t n = sim_usb_packet(c, first, usb->packets++, bytes, &usb->next_event);
    uint32_t step = c->events[first % c->config.event_queue].step;
    if (sim_controller_due_from(c, SIM_CONTROLLER_LOSE_PACKET, step))
        return;
    if (sim_controller_due_from(c, SIM_CONTROLLER_DAMAGE_PACKET, step))
        bytes[n / 2] ^= 4;
    g_queue_remove(&usb->waiting, urb);
    if (n > (size_t)usbdevfs(urb)->buffer_length) {
        give_back(usb, urb, -EOVERFLOW, 0);
        return;
    }
    memcpy(urb->buffer->data, bytes, n);
    give_back(usb, urb, 0, (int)n);
}

static void send_events(struct sim_controller *c)
{
    struct usb *usb = c->wire_data;
    struct urb *urb;
    if (usb->boot != c->boot)
        usb->packets = 0;
    if (usb->boot != c->boot || usb->arm != c->arm)
        usb->next_event = 0;
    usb->boot = c->boot;
    usb->arm = c->arm;
    if ((int32_t)(c->event_first - usb->next_event) > 0)
        usb->next_event = c->event_first;
    while ((urb = waiting_for_events(usb)) && (c->halt || usb->halted)) {
        c->halt = false;
        usb->halted = true;
        g_queue_remove(&usb->waiting, urb);
        give_back(usb, urb, -EPIPE, 0);
    }
    while (usb->plugged && !sim_controller_is_dead(c) && usb->next_event != c->event_next &&
           (urb = waiting_for_events(usb)))
        send_packet(c, usb, urb);
}

static void submit(struct sim_controller *c, struct usb *usb, struct urb *urb)
{
    if (usbdevfs(urb)->type == USBDEVFS_URB_TYPE_CONTROL && !sim_controller_is_dead(c)) {
        control(c, usb, urb);
        return;
    }
    g_queue_push_tail(&usb->waiting, urb);
    send_events(c);
}

/* ---- ioctls, on a thread of umockdev's ---- */

static struct urb *urb_of(UMockdevIoctlData *arg, const UMockdevIoctlClient *owner)
{
    struct urb *urb = g_new0(struct urb, 1);
    urb->owner = owner;
    memcpy(&urb->address, arg->data, sizeof urb->address);
    urb->data = umockdev_ioctl_data_resolve(arg, 0, sizeof(struct usbdevfs_urb), NULL);
    if (urb->data && usbdevfs(urb)->buffer_length > 0)
        urb->buffer = umockdev_ioctl_data_resolve(urb->data, offsetof(struct usbdevfs_urb, buffer),
                                                  (gsize)usbdevfs(urb)->buffer_length, NULL);
    return urb;
}

static int do_submit(struct sim_controller *c, struct usb *usb, const UMockdevIoctlClient *client,
                     UMockdevIoctlData *arg)
{
    struct urb *urb = urb_of(arg, client);
    if (!urb->buffer) {
        urb_free(urb);
        return EINVAL;
    }
    pthread_mutex_lock(&c->lock);
    bool there = usb->plugged;
    if (there)
        submit(c, usb, urb);
    pthread_mutex_unlock(&c->lock);
    if (!there)
        urb_free(urb);
    return there ? 0 : ENODEV;
}

static int do_discard(struct sim_controller *c, struct usb *usb, const UMockdevIoctlClient *client,
                      UMockdevIoctlData *arg)
{
    unsigned long address;
    int error = EINVAL;
    memcpy(&address, arg->data, sizeof address);
    pthread_mutex_lock(&c->lock);
    for (GList *link = usb->waiting.head; link; link = link->next) {
        struct urb *urb = link->data;
        if (urb->address != address || urb->owner != client)
            continue;
        g_queue_delete_link(&usb->waiting, link);
        give_back(usb, urb, -ENOENT, 0);
        error = 0;
        break;
    }
    pthread_mutex_unlock(&c->lock);
    return error;
}

/** The first that has come back to @client: another's is memory of another libusb. */
static struct urb *pop_done(struct usb *usb, const UMockdevIoctlClient *client)
{
    for (GList *link = usb->done.head; link; link = link->next) {
        struct urb *urb = link->data;
        if (urb->owner != client)
            continue;
        g_queue_delete_link(&usb->done, link);
        return urb;
    }
    return NULL;
}

/** Completing the ioctl carries the transfer's data over, so it is done here. */
static bool do_reap(struct sim_controller *c, struct usb *usb, UMockdevIoctlClient *client,
                    UMockdevIoctlData *arg, int *error)
{
    pthread_mutex_lock(&c->lock);
    struct urb *urb = pop_done(usb, client);
    if (!usb->done.length && usb->plugged)
        set_ready(usb, false);
    *error = usb->plugged ? EAGAIN : ENODEV;
    pthread_mutex_unlock(&c->lock);
    if (!urb)
        return false;
    UMockdevIoctlData *pointer = umockdev_ioctl_data_resolve(arg, 0, sizeof(void *), NULL);
    umockdev_ioctl_data_set_ptr(pointer, 0, urb->data);
    umockdev_ioctl_client_complete(client, 0, 0);
    g_object_unref(pointer);
    urb_free(urb);
    return true;
}

static int do_capabilities(UMockdevIoctlData *arg)
{
    uint32_t can = USBDEVFS_CAP_NO_PACKET_SIZE_LIM | USBDEVFS_CAP_REAP_AFTER_DISCONNECT |
                   USBDEVFS_CAP_ZERO_PACKET;
    UMockdevIoctlData *data = umockdev_ioctl_data_resolve(arg, 0, sizeof can, NULL);
    if (!data)
        return EFAULT;
    memcpy(data->data, &can, sizeof can);
    g_object_unref(data);
    return 0;
}

static int do_clear_halt(struct sim_controller *c, struct usb *usb)
{
    pthread_mutex_lock(&c->lock);
    usb->halted = false;
    pthread_mutex_unlock(&c->lock);
    return 0;
}

/** The interface is one opener's, as the kernel has it. */
static int do_claim(struct sim_controller *c, struct usb *usb, const UMockdevIoctlClient *client,
                    bool claim)
{
    pthread_mutex_lock(&c->lock);
    bool free_or_ours = !usb->claimer || usb->claimer == client;
    if (free_or_ours)
        usb->claimer = claim ? client : NULL;
    pthread_mutex_unlock(&c->lock);
    return free_or_ours ? 0 : claim ? EBUSY : EINVAL;
}

static void drop_of(GQueue *queue, const UMockdevIoctlClient *client)
{
    for (GList *link = queue->head, *next; link; link = next) {
        struct urb *urb = link->data;
        next = link->next;
        if (urb->owner != client)
            continue;
        g_queue_delete_link(queue, link);
        urb_free(urb);
    }
}

/** It closed the node, or died: what was its is nobody's. */
static void on_vanished(UMockdevIoctlBase *base, UMockdevIoctlClient *client, gpointer user)
{
    (void)base;
    struct sim_controller *c = user;
    struct usb *usb = c->wire_data;
    pthread_mutex_lock(&c->lock);
    drop_of(&usb->waiting, client);
    drop_of(&usb->done, client);
    if (usb->claimer == client)
        usb->claimer = NULL;
    if (!usb->done.length && usb->plugged)
        set_ready(usb, false);
    pthread_mutex_unlock(&c->lock);
}

static int answer(struct sim_controller *c, struct usb *usb, const UMockdevIoctlClient *client,
                  unsigned long request, UMockdevIoctlData *arg)
{
    pthread_mutex_lock(&c->lock);
    bool there = usb->plugged;
    pthread_mutex_unlock(&c->lock);
    if (!there)
        return ENODEV;
    switch (request) {
    case USBDEVFS_SUBMITURB:
        return do_submit(c, usb, client, arg);
    case USBDEVFS_DISCARDURB:
        return do_discard(c, usb, client, arg);
    case USBDEVFS_GET_CAPABILITIES:
        return do_capabilities(arg);
    case USBDEVFS_CLEAR_HALT:
        return do_clear_halt(c, usb);
    case USBDEVFS_GETDRIVER:
        return ENODATA;
    case USBDEVFS_CLAIMINTERFACE:
        return do_claim(c, usb, client, true);
    case USBDEVFS_RELEASEINTERFACE:
        return do_claim(c, usb, client, false);
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_RESET:
        return 0;
    default:
        return ENOTTY;
    }
}

static gboolean on_ioctl(UMockdevIoctlBase *base, UMockdevIoctlClient *client, gpointer user)
{
    (void)base;
    struct sim_controller *c = user;
    struct usb *usb = c->wire_data;
    unsigned long request = umockdev_ioctl_client_get_request(client);
    UMockdevIoctlData *arg = umockdev_ioctl_client_get_arg(client);
    int error;
    if (request == USBDEVFS_REAPURB || request == USBDEVFS_REAPURBNDELAY) {
        if (do_reap(c, usb, client, arg, &error))
            return TRUE;
    } else {
        error = answer(c, usb, client, request, arg);
    }
    umockdev_ioctl_client_complete(client, error ? -1 : 0, error);
    return TRUE;
}

/* ---- plugging ---- */

static bool make_node(struct sim_controller *c, struct usb *usb)
{
    char folder[192], path[256];
    snprintf(folder, sizeof folder, "%s/dev/bus/usb/001", c->path);
    snprintf(path, sizeof path, "%s%s", c->path, usb->node);
    if (g_mkdir_with_parents(folder, 0755) || mkfifo(path, 0666))
        return false;
    usb->ready = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (usb->ready < 0)
        return false;
    fcntl(usb->ready, F_SETPIPE_SZ, 4096);
    set_ready(usb, false);
    return true;
}

/** Adding the device tells its listeners: everything is there before. */
static bool plug(struct sim_controller *c, struct usb *usb)
{
    char text[2048];
    int number = ++usb->device_number;
    snprintf(usb->node, sizeof usb->node, "/dev/bus/usb/001/%03d", number);
    snprintf(usb->syspath, sizeof usb->syspath, "/sys/devices/usb1/1-%d", number);
    sim_usb_describe(number, text, sizeof text);
    pthread_mutex_lock(&c->lock);
    usb->halted = false;
    usb->plugged = make_node(c, usb);
    bool made = usb->plugged;
    pthread_mutex_unlock(&c->lock);
    return made && umockdev_testbed_attach_ioctl(usb->testbed, usb->node, usb->ioctls, NULL) &&
           umockdev_testbed_add_from_string(usb->testbed, text, NULL);
}

static void unplug(struct sim_controller *c, struct usb *usb)
{
    struct urb *urb;
    pthread_mutex_lock(&c->lock);
    usb->plugged = false;
    usb->claimer = NULL;
    while ((urb = g_queue_pop_head(&usb->waiting)))
        give_back(usb, urb, -ESHUTDOWN, 0);
    set_ready(usb, true);
    pthread_mutex_unlock(&c->lock);
    umockdev_testbed_uevent(usb->testbed, usb->syspath, "remove");
    umockdev_testbed_remove_device(usb->testbed, usb->syspath);
    umockdev_testbed_detach_ioctl(usb->testbed, usb->node, NULL);
    char path[256];
    snprintf(path, sizeof path, "%s%s", c->path, usb->node);
    unlink(path);
    close(usb->ready);
    usb->ready = -1;
}

/** Until kicked, or for @ms (-1: no limit). */
static void await_kick(struct sim_controller *c, int ms)
{
    struct pollfd fd = {c->kick_fd, POLLIN, 0};
    eventfd_t kicks;
    if (poll(&fd, 1, ms) > 0)
        eventfd_read(c->kick_fd, &kicks);
}

static void usb_serve(struct sim_controller *c)
{
    struct usb *usb = c->wire_data;
    while (!sim_controller_quitting(c)) {
        await_kick(c, -1);
        pthread_mutex_lock(&c->lock);
        bool pull = c->disconnect;
        double ms = c->reconnect_ms;
        c->disconnect = false;
        pthread_mutex_unlock(&c->lock);
        if (!pull || !usb->plugged)
            continue;
        unplug(c, usb);
        await_kick(c, ms > 0 ? (int)ms : -1);
        if (ms > 0 && !sim_controller_quitting(c) && !plug(c, usb))
            fprintf(stderr, "lightstage-sim: controller: cannot be plugged in again\n");
    }
}

static enum ls_err usb_open(struct sim_controller *c, struct ls_diag *diag)
{
    struct usb *usb = c->wire_data = calloc(1, sizeof *usb);
    if (!usb)
        return ls_fail(diag, LS_ERR_NOMEM, "controller: out of memory");
    usb->ready = -1;
    usb->testbed = umockdev_testbed_new();
    if (!umockdev_in_mock_environment())
        return ls_fail(diag, LS_ERR_STATE,
                       "controller on USB: start this process with "
                       "LD_PRELOAD=libumockdev-preload.so.0");
    usb->ioctls = umockdev_ioctl_base_new();
    usb->handler = g_signal_connect(usb->ioctls, "handle-ioctl", G_CALLBACK(on_ioctl), c);
    usb->vanished = g_signal_connect(usb->ioctls, "client-vanished", G_CALLBACK(on_vanished), c);
    char *root = umockdev_testbed_get_root_dir(usb->testbed);
    snprintf(c->path, sizeof c->path, "%s", root);
    g_free(root);
    if (!plug(c, usb))
        return ls_fail(diag, LS_ERR_OS, "controller: no USB testbed in %s: %s", c->path,
                       strerror(errno));
    return LS_OK;
}

static void usb_close(struct sim_controller *c)
{
    struct usb *usb = c->wire_data;
    if (!usb)
        return;
    if (usb->plugged)
        unplug(c, usb);
    if (usb->handler)
        g_signal_handler_disconnect(usb->ioctls, usb->handler);
    if (usb->vanished)
        g_signal_handler_disconnect(usb->ioctls, usb->vanished);
    g_queue_clear_full(&usb->waiting, urb_free);
    g_queue_clear_full(&usb->done, urb_free);
    if (usb->testbed)
        umockdev_testbed_clear(usb->testbed);
    g_clear_object(&usb->ioctls);
    g_clear_object(&usb->testbed);
    free(usb);
}

const struct sim_wire sim_wire_usb = {
    .open = usb_open,
    .serve = usb_serve,
    .event = send_events,
    .close = usb_close,
};
