#include "drivers/usb/usb.h"

#include "drivers/usb/packet.h"

#include <libusb.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>

enum {
    IN_FLIGHT = 8,    /* event transfers, so that none waits for the host */
    MOST_REGS = 125,  /* of a transaction, as on Modbus */
    CLOSING_MS = 200, /* for cancelled transfers to come back */
    ENGLISH = 0x0409, /* of strings */
};

struct usb_link {
    struct ls_link link;
    libusb_context *context;
    libusb_device_handle *device; /* NULL: not connected */
    char serial[64];              /* wanted; "any" */
    unsigned timeout_ms;
    struct libusb_transfer *control;
    uint8_t request[LIBUSB_CONTROL_SETUP_SIZE + 2 * MOST_REGS];
    int done; /* the control transfer has come back */
    struct libusb_transfer *incoming[IN_FLIGHT];
    uint8_t packet[IN_FLIGHT][LS_WIRE_USB_PACKET_BYTES];
    bool flying[IN_FLIGHT];
    bool halted; /* the event endpoint stalled */
    struct ls_event_queue events;
};

static struct usb_link *of(struct ls_link *link)
{
    return (struct usb_link *)link;
}

static void handle_events(struct usb_link *u, unsigned ms, int *done)
{
    struct timeval limit = {.tv_sec = ms / 1000, .tv_usec = ms % 1000 * 1000};
    (void)!libusb_handle_events_timeout_completed(u->context, &limit, done);
}

/* ---- events ---- */

static bool fly(struct usb_link *u, int i)
{
    u->flying[i] = libusb_submit_transfer(u->incoming[i]) == 0;
    return u->flying[i];
}

static void on_packet(struct libusb_transfer *transfer)
{
    struct usb_link *u = transfer->user_data;
    int i = 0;
    while (u->incoming[i] != transfer)
        i++;
    u->flying[i] = false;
    if (transfer->status == LIBUSB_TRANSFER_COMPLETED)
        /* a damaged packet's events come with the status block */
        (void)!ls_event_queue_receive(&u->events, transfer->buffer,
                                      (size_t)transfer->actual_length);
    else if (transfer->status == LIBUSB_TRANSFER_STALL)
        u->halted = true;
    if (u->link.connected && !u->halted && transfer->status == LIBUSB_TRANSFER_COMPLETED)
        fly(u, i);
}

/** Transfers that came back with an error fly again, once the endpoint is free to. */
static void keep_flying(struct usb_link *u)
{
    if (u->halted)
        u->halted = libusb_clear_halt(u->device, LS_WIRE_USB_EVENTS) != 0;
    for (int i = 0; i < IN_FLIGHT && !u->halted; i++)
        if (!u->flying[i] && !fly(u, i))
            return;
}

static bool link_take_event(struct ls_link *link, uint32_t boot, uint16_t arm, uint32_t sequence,
                            uint16_t record[LS_WIRE_EVENT_SIZE])
{
    struct usb_link *u = of(link);
    if (ls_event_queue_take(&u->events, boot, arm, sequence, record))
        return true;
    if (!link->connected)
        return false;
    handle_events(u, 0, NULL);
    return ls_event_queue_take(&u->events, boot, arm, sequence, record);
}

/* ---- life ---- */

static bool are_flying(const struct usb_link *u)
{
    for (int i = 0; i < IN_FLIGHT; i++)
        if (u->flying[i])
            return true;
    return false;
}

static void link_disconnect(struct ls_link *link)
{
    struct usb_link *u = of(link);
    link->connected = false;
    if (!u->device)
        return;
    for (int i = 0; i < IN_FLIGHT; i++)
        if (u->flying[i])
            libusb_cancel_transfer(u->incoming[i]);
    for (int waited = 0; are_flying(u) && waited < CLOSING_MS; waited++)
        handle_events(u, 1, NULL);
    libusb_release_interface(u->device, LS_WIRE_USB_INTERFACE);
    libusb_close(u->device); /* lets go of transfers that never came back */
    memset(u->flying, 0, sizeof u->flying);
    u->device = NULL;
    u->halted = false;
}

static enum ls_err failed(struct usb_link *u, const char *doing, int error, struct ls_diag *diag)
{
    const char *serial = u->serial;
    if (error == LIBUSB_ERROR_ACCESS)
        return ls_fail(diag, LS_ERR_REFUSED,
                       "USB controller \"%s\": %s: no permission; a udev rule for 1209:0001 must "
                       "let this user open it",
                       serial, doing);
    if (error == LIBUSB_ERROR_BUSY)
        return ls_fail(diag, LS_ERR_BUSY,
                       "USB controller \"%s\": %s: it is in use, by this or another process",
                       serial, doing);
    if (error == LIBUSB_ERROR_TIMEOUT)
        return ls_fail(diag, LS_ERR_TIMEOUT, "USB controller \"%s\": %s: no answer within %u ms",
                       serial, doing, u->timeout_ms);
    if (error == LIBUSB_ERROR_NO_MEM)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    return ls_fail(diag, LS_ERR_GONE, "USB controller \"%s\": %s: %s", serial, doing,
                   libusb_strerror(error));
}

static bool is_controller(libusb_device *device)
{
    struct libusb_device_descriptor d;
    return !libusb_get_device_descriptor(device, &d) && d.idVendor == LS_WIRE_USB_VENDOR &&
           d.idProduct == LS_WIRE_USB_PRODUCT;
}

/** Is the string descriptor of @n bytes, in UTF-16LE, this ASCII text? */
static bool says(const uint8_t *descriptor, size_t n, const char *text)
{
    size_t length = strlen(text);
    if (n != 2 + 2 * length || descriptor[0] != n || descriptor[1] != LIBUSB_DT_STRING)
        return false;
    for (size_t i = 0; i < length; i++)
        if (descriptor[2 + 2 * i] != (uint8_t)text[i] || descriptor[3 + 2 * i])
            return false;
    return true;
}

/** An error of libusb, or 0. libusb's own call for strings waits a second, whatever ours is. */
static int is_wanted(const struct usb_link *u, libusb_device_handle *handle, bool *wanted)
{
    struct libusb_device_descriptor d;
    uint8_t descriptor[255];
    *wanted = !strcmp(u->serial, "any");
    if (*wanted || libusb_get_device_descriptor(libusb_get_device(handle), &d) || !d.iSerialNumber)
        return 0;
    int n = libusb_control_transfer(handle, LIBUSB_ENDPOINT_IN, LIBUSB_REQUEST_GET_DESCRIPTOR,
                                    (uint16_t)(LIBUSB_DT_STRING << 8 | d.iSerialNumber), ENGLISH,
                                    descriptor, sizeof descriptor, u->timeout_ms);
    *wanted = n > 0 && says(descriptor, (size_t)n, u->serial);
    return n < 0 && n != LIBUSB_ERROR_PIPE ? n : 0; /* a stall: it has no such string */
}

struct search {
    libusb_device_handle *found;
    unsigned n; /* controllers wanted */
    int error;  /* of one that could not be asked */
    const char *doing;
};

static void look_at(struct usb_link *u, libusb_device *device, struct search *search)
{
    libusb_device_handle *handle;
    bool wanted;
    int error = libusb_open(device, &handle);
    if (error) {
        search->error = error;
        search->doing = "opening";
        return;
    }
    error = is_wanted(u, handle, &wanted);
    if (error) {
        search->error = error;
        search->doing = "reading serial numbers";
    }
    if (wanted && !search->n++)
        search->found = handle;
    else
        libusb_close(handle);
}

static enum ls_err several(const struct usb_link *u, unsigned n, struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_INVALID, "USB controller \"%s\": %u are plugged in; %s", u->serial,
                   n,
                   strcmp(u->serial, "any") ? "leave one of them, or give each its own number"
                                            : "name one by its serial number");
}

static enum ls_err find(struct usb_link *u, struct ls_diag *diag)
{
    libusb_device **list;
    struct search search = {0};
    ssize_t n = libusb_get_device_list(u->context, &list);
    if (n < 0)
        return failed(u, "listing devices", (int)n, diag);
    for (ssize_t i = 0; i < n; i++)
        if (is_controller(list[i]))
            look_at(u, list[i], &search);
    libusb_free_device_list(list, 1);
    if (search.n > 1) {
        libusb_close(search.found);
        return several(u, search.n, diag);
    }
    u->device = search.found;
    if (search.n)
        return LS_OK;
    if (search.error)
        return failed(u, search.doing, search.error, diag);
    return ls_fail(
        diag, LS_ERR_GONE,
        "USB controller \"%s\": not plugged in, or not powered, or another serial number",
        u->serial);
}

static int on_arrival(libusb_context *context, libusb_device *device, libusb_hotplug_event event,
                      void *arrived)
{
    (void)context, (void)device, (void)event;
    *(int *)arrived = 1;
    return 0;
}

static enum ls_err find_and_claim(struct usb_link *u, struct ls_diag *diag)
{
    enum ls_err err = find(u, diag);
    int error = err ? 0 : libusb_claim_interface(u->device, LS_WIRE_USB_INTERFACE);
    if (!error)
        return err;
    libusb_close(u->device);
    u->device = NULL;
    return failed(u, "claiming its interface", error, diag);
}

/** Claim it, and if it is not there, or about to leave, wait one timeout for it to be plugged in.
 */
static enum ls_err await(struct usb_link *u, struct ls_diag *diag)
{
    libusb_hotplug_callback_handle callback;
    int arrived = 0;
    int64_t limit = ls_link_now_ms() + (int64_t)u->timeout_ms, left;
    int error = libusb_hotplug_register_callback(
        u->context, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED, 0, LS_WIRE_USB_VENDOR, LS_WIRE_USB_PRODUCT,
        LIBUSB_HOTPLUG_MATCH_ANY, on_arrival, &arrived, &callback);
    if (error)
        return failed(u, "waiting for it", error, diag);
    enum ls_err err = find_and_claim(u, diag);
    while (err == LS_ERR_GONE && (left = limit - ls_link_now_ms()) > 0) {
        handle_events(u, (unsigned)left, &arrived);
        if (!arrived)
            continue;
        arrived = 0;
        err = find_and_claim(u, diag);
    }
    libusb_hotplug_deregister_callback(u->context, callback);
    return err;
}

static enum ls_err link_connect(struct ls_link *link, struct ls_diag *diag)
{
    struct usb_link *u = of(link);
    if (link->connected)
        return LS_OK;
    enum ls_err err = await(u, diag);
    if (err)
        return err;
    for (int i = 0; i < IN_FLIGHT; i++)
        libusb_fill_interrupt_transfer(u->incoming[i], u->device, LS_WIRE_USB_EVENTS, u->packet[i],
                                       LS_WIRE_USB_PACKET_BYTES, on_packet, u, 0);
    link->connected = true;
    keep_flying(u);
    return LS_OK;
}

/* ---- transactions ---- */

static void on_answer(struct libusb_transfer *transfer)
{
    *(int *)transfer->user_data = 1;
}

static enum ls_err judge(struct ls_link *link, const char *doing, unsigned address, unsigned n,
                         bool writing, struct ls_diag *diag)
{
    struct usb_link *u = of(link);
    switch (u->control->status) {
    case LIBUSB_TRANSFER_COMPLETED:
        if (u->control->actual_length == (int)(2 * n))
            return LS_OK;
        link_disconnect(link);
        return ls_fail(diag, LS_ERR_GONE,
                       "USB controller \"%s\": %s at register %u: %d bytes, expected %u", u->serial,
                       doing, address, u->control->actual_length, 2 * n);
    case LIBUSB_TRANSFER_STALL:
        return ls_fail(diag, writing ? LS_ERR_REFUSED : LS_ERR_UNSUPPORTED,
                       "%s at register %u: refused by the controller", doing, address);
    case LIBUSB_TRANSFER_TIMED_OUT:
        link_disconnect(link);
        return failed(u, doing, LIBUSB_ERROR_TIMEOUT, diag);
    default:
        link_disconnect(link);
        return ls_fail(diag, LS_ERR_GONE, "USB controller \"%s\": %s: it was unplugged", u->serial,
                       doing);
    }
}

/** The request stands in u->request. libusb itself ends it after the timeout. */
static enum ls_err transact(struct ls_link *link, uint8_t type, uint8_t number, unsigned address,
                            unsigned n, struct ls_diag *diag)
{
    struct usb_link *u = of(link);
    bool writing = number == LS_WIRE_USB_WRITE;
    const char *doing = writing ? "writing" : "reading";
    if (!link->connected)
        return failed(u, doing, LIBUSB_ERROR_NO_DEVICE, diag);
    keep_flying(u);
    libusb_fill_control_setup(u->request, type, number, 0, (uint16_t)address, (uint16_t)(2 * n));
    libusb_fill_control_transfer(u->control, u->device, u->request, on_answer, &u->done,
                                 u->timeout_ms);
    u->done = 0;
    link->before_ns = ls_link_now_ns();
    int error = libusb_submit_transfer(u->control);
    if (error) {
        link_disconnect(link);
        return failed(u, doing, error, diag);
    }
    while (!u->done)
        handle_events(u, u->timeout_ms, &u->done);
    link->after_ns = ls_link_now_ns();
    return judge(link, doing, address, n, writing, diag);
}

static enum ls_err link_read(struct ls_link *link, unsigned address, unsigned n, uint16_t *regs,
                             struct ls_diag *diag)
{
    struct usb_link *u = of(link);
    enum ls_err err =
        transact(link, LIBUSB_ENDPOINT_IN | LIBUSB_REQUEST_TYPE_VENDOR | LIBUSB_RECIPIENT_DEVICE,
                 LS_WIRE_USB_READ, address, n, diag);
    if (!err)
        ls_wire_get_registers(u->request + LIBUSB_CONTROL_SETUP_SIZE, n, regs);
    return err;
}

static enum ls_err link_write(struct ls_link *link, unsigned address, unsigned n,
                              const uint16_t *regs, struct ls_diag *diag)
{
    struct usb_link *u = of(link);
    ls_wire_put_registers(regs, n, u->request + LIBUSB_CONTROL_SETUP_SIZE);
    return transact(link,
                    LIBUSB_ENDPOINT_OUT | LIBUSB_REQUEST_TYPE_VENDOR | LIBUSB_RECIPIENT_DEVICE,
                    LS_WIRE_USB_WRITE, address, n, diag);
}

static enum ls_err link_write_read(struct ls_link *link, unsigned write_address, unsigned n_write,
                                   const uint16_t *write, unsigned read_address, unsigned n_read,
                                   uint16_t *read, struct ls_diag *diag)
{
    enum ls_err err = link_write(link, write_address, n_write, write, diag);
    return err ? err : link_read(link, read_address, n_read, read, diag);
}

static void link_destroy(struct ls_link *link)
{
    struct usb_link *u = of(link);
    link_disconnect(link);
    libusb_free_transfer(u->control);
    for (int i = 0; i < IN_FLIGHT; i++)
        libusb_free_transfer(u->incoming[i]);
    if (u->context)
        libusb_exit(u->context);
    free(u);
}

static const struct ls_link_ops usb_ops = {
    .connect = link_connect,
    .disconnect = link_disconnect,
    .read = link_read,
    .write = link_write,
    .write_read = link_write_read,
    .take_event = link_take_event,
    .destroy = link_destroy,
};

static bool allocate(struct usb_link *u)
{
    u->control = libusb_alloc_transfer(0);
    bool good = u->control;
    for (int i = 0; i < IN_FLIGHT; i++)
        good = (u->incoming[i] = libusb_alloc_transfer(0)) && good;
    return good;
}

static enum ls_err create(const struct ls_lights_config *config, struct ls_link **out,
                          struct ls_diag *diag)
{
    *out = NULL;
    if (strlen(config->address) >= sizeof(((struct usb_link *)0)->serial))
        return ls_fail(diag, LS_ERR_INVALID,
                       "USB controller \"%s\": expected a serial number or \"any\"",
                       config->address);
    struct usb_link *u = calloc(1, sizeof *u);
    if (!u)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    u->link.ops = &usb_ops;
    u->timeout_ms = config->timeout_ms;
    snprintf(u->serial, sizeof u->serial, "%s", config->address);
    int error = libusb_init(&u->context);
    if (!error && allocate(u)) {
        *out = &u->link;
        return LS_OK;
    }
    enum ls_err err = failed(u, "starting libusb", error ? error : LIBUSB_ERROR_NO_MEM, diag);
    link_destroy(&u->link);
    return err;
}

const struct ls_wire ls_wire_usb = {.name = "usb", .create = create};
