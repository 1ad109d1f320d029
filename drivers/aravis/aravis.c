#include "drivers/aravis/aravis.h"

#include "drivers/aravis/receive_path.h"
#include "drivers/aravis/settings.h"
#include "drivers/aravis/watch.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

enum {
    INITIAL_PACKET_TIMEOUT_US = 500,
    LEAST_PACKET_TIMEOUT_US = 5000,
    PACKETS_LATE = 8, /* a packet is asked for once more when so many could have come since */
    DEFAULT_RETENTION_US = 200000,
    BLOCK_IDS = 65535, /* 16-bit ids run 1..65535 */
    SETTLE_MS = 20,    /* longer than the packet ring holds a packet back */
    MAX_ATTEMPTS = 4,
};

struct aravis {
    ArvCamera *camera;
    char address[INET_ADDRSTRLEN];
    struct ls_aravis_setup setup;
    uint32_t retention_us, packet_timeout_us;
    int rt_priority;

    ArvStream *stream;
    struct ls_aravis_watch *watch; /* while it streams */
    size_t n_slots;
    _Atomic(ArvBuffer *) *held; /* per slot: the buffer the caller has, or NULL */
    uint64_t raw_id, frame_id;  /* of the last good frame; 0 = none yet */
    sem_t receiving, received;  /* posted when the receive thread runs; when it ends */
    atomic_bool realtime;

    /* `users` are inside next or release; stop keeps new ones out and waits for those. Whoever
     * leaves while stopping says so on `left`; `wake` ends a wait in next. */
    atomic_bool gone, aborted, stopping;
    atomic_uint users;
    int wake, left;
};

/* --- frames --- */

/** Extend 16-bit ids (1..65535, then 1) by what has passed since the last good frame. Cameras
 * with 64-bit ids never wrap. */
static uint64_t extend_id(struct aravis *a, uint64_t raw)
{
    int64_t step = (int64_t)(raw - a->raw_id);
    if (!a->raw_id) {
        a->frame_id = raw;
    } else {
        if (raw <= BLOCK_IDS && a->raw_id <= BLOCK_IDS && step < -BLOCK_IDS / 2)
            step += BLOCK_IDS;
        else if (raw <= BLOCK_IDS && a->raw_id <= BLOCK_IDS && step > BLOCK_IDS / 2)
            step -= BLOCK_IDS;
        a->frame_id += (uint64_t)step;
    }
    a->raw_id = raw;
    return a->frame_id;
}

static bool is_good(const struct aravis *a, ArvBuffer *buffer)
{
    if (arv_buffer_get_status(buffer) != ARV_BUFFER_STATUS_SUCCESS)
        return false;
    return (uint32_t)arv_buffer_get_image_width(buffer) == a->setup.width &&
           (uint32_t)arv_buffer_get_image_height(buffer) == a->setup.height &&
           arv_buffer_get_image_pixel_format(buffer) == a->setup.pixel_format &&
           arv_buffer_get_frame_id(buffer) != 0;
}

static uint32_t slot_of(ArvBuffer *buffer)
{
    return GPOINTER_TO_UINT(arv_buffer_get_user_data(buffer));
}

static void describe(struct aravis *a, ArvBuffer *buffer, struct ls_camera_frame *frame)
{
    double value;
    *frame = (struct ls_camera_frame){
        .slot = slot_of(buffer),
        .status = LS_FRAME_LOST,
        .host_ns = ls_aravis_host_ns(),
    };
    if (!is_good(a, buffer))
        return;
    frame->status = LS_FRAME_OK;
    frame->payload_bytes = a->setup.image_bytes;
    frame->frame_id = extend_id(a, arv_buffer_get_frame_id(buffer));
    frame->camera_ns = arv_buffer_get_timestamp(buffer);
    if (ls_aravis_chunk_read(&a->setup.counter, buffer, &value))
        frame->trigger_counter = (uint32_t)value;
    if (ls_aravis_chunk_read(&a->setup.exposure, buffer, &value))
        frame->chunk_exposure_us = value;
}

static bool take(struct aravis *a, struct ls_camera_frame *frame)
{
    ArvBuffer *buffer = arv_stream_try_pop_buffer(a->stream);
    if (!buffer)
        return false;
    describe(a, buffer, frame);
    atomic_store(&a->held[frame->slot], buffer);
    return true;
}

static enum ls_err wait_frame(struct aravis *a, uint64_t timeout_us, struct ls_camera_frame *frame)
{
    uint64_t end_ns = ls_aravis_host_ns() + timeout_us * 1000;
    struct pollfd wake = {a->wake, POLLIN, 0};
    eventfd_t ignored;
    for (;;) {
        if (atomic_load(&a->aborted))
            return LS_ERR_ABORTED;
        if (take(a, frame))
            return LS_OK;
        if (atomic_load(&a->gone))
            return LS_ERR_GONE;
        uint64_t now_ns = ls_aravis_host_ns();
        if (now_ns >= end_ns)
            return LS_ERR_TIMEOUT;
        struct timespec rest = {(time_t)((end_ns - now_ns) / 1000000000u),
                                (long)((end_ns - now_ns) % 1000000000u)};
        if (ppoll(&wake, 1, &rest, NULL) > 0)
            eventfd_read(a->wake, &ignored);
    }
}

static bool enter(struct aravis *a)
{
    atomic_fetch_add(&a->users, 1);
    return !atomic_load(&a->stopping);
}

static void leave(struct aravis *a)
{
    atomic_fetch_sub(&a->users, 1);
    if (atomic_load(&a->stopping))
        eventfd_write(a->left, 1);
}

static enum ls_err aravis_next(void *priv, uint64_t timeout_us, struct ls_camera_frame *frame)
{
    struct aravis *a = priv;
    enum ls_err err = enter(a) ? wait_frame(a, timeout_us, frame) : LS_ERR_ABORTED;
    leave(a);
    return err;
}

static void aravis_release(void *priv, uint32_t slot)
{
    struct aravis *a = priv;
    if (enter(a)) {
        ArvBuffer *buffer = atomic_exchange(&a->held[slot], NULL);
        if (buffer)
            arv_stream_push_buffer(a->stream, buffer);
    }
    leave(a);
}

/* --- what Aravis' own threads tell --- */

static void on_stream(void *user, ArvStreamCallbackType type, ArvBuffer *buffer)
{
    struct aravis *a = user;
    struct sched_param priority = {.sched_priority = a->rt_priority};
    if (type == ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE)
        eventfd_write(a->wake, 1);
    if (type == ARV_STREAM_CALLBACK_TYPE_EXIT)
        sem_post(&a->received);
    if (type != ARV_STREAM_CALLBACK_TYPE_INIT)
        return;
    if (a->rt_priority > 0)
        pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);
    atomic_store(&a->realtime, sched_getscheduler(0) == SCHED_FIFO);
    sem_post(&a->receiving);
}

static void note_gone(void *user)
{
    struct aravis *a = user;
    atomic_store(&a->gone, true);
    eventfd_write(a->wake, 1);
}

static void on_control_lost(ArvDevice *device, void *user)
{
    note_gone(user);
}

/* --- life --- */

static void describe_device(struct aravis *a, struct ls_camera_info *info)
{
    GError *error = NULL;
    int width = 0, height = 0;
    const char *vendor = arv_camera_get_vendor_name(a->camera, NULL);
    const char *model = arv_camera_get_model_name(a->camera, NULL);
    const char *serial = arv_camera_get_device_serial_number(a->camera, NULL);
    memset(info, 0, sizeof *info);
    info->packet_socket = ls_aravis_packet_sockets_allowed();
    snprintf(info->vendor, sizeof info->vendor, "%s", vendor ? vendor : "");
    snprintf(info->model, sizeof info->model, "%s", model ? model : "");
    snprintf(info->serial, sizeof info->serial, "%s", serial ? serial : "");
    arv_camera_get_sensor_size(a->camera, &width, &height, NULL);
    info->sensor_width = (uint32_t)width;
    info->sensor_height = (uint32_t)height;
    info->tick_hz = arv_gv_device_get_timestamp_tick_frequency(
        ARV_GV_DEVICE(arv_camera_get_device(a->camera)), &error);
    if (error)
        info->tick_hz = 0;
    g_clear_error(&error);
}

static enum ls_err connect_camera(struct aravis *a, struct ls_diag *diag)
{
    GError *error = NULL;
    a->camera = arv_camera_new(a->address, &error);
    if (!a->camera) {
        enum ls_err err = ls_fail(diag, LS_ERR_GONE, "camera %s: nobody answers there: %s",
                                  a->address, error ? error->message : "not found");
        g_clear_error(&error);
        return err;
    }
    ArvDevice *device = arv_camera_get_device(a->camera);
    if (!ARV_IS_GV_DEVICE(device))
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "camera %s: not a GigE Vision camera", a->address);
    if (!arv_gv_device_is_controller(ARV_GV_DEVICE(device)))
        return ls_fail(diag, LS_ERR_BUSY,
                       "camera %s: another program controls it; if that one has died the camera "
                       "lets go of it by its heartbeat, within seconds: try again",
                       a->address);
    g_signal_connect(device, "control-lost", G_CALLBACK(on_control_lost), a);
    return LS_OK;
}

/** Do what waits for the camera's answers. One that is gone gets some 3 s for each: nobody else
 * needs to wait for those. */
static void take_leave(struct aravis *a, GThreadFunc last_words, void *data)
{
    GThread *thread =
        atomic_load(&a->gone) ? g_thread_try_new("ls-leave", last_words, data, NULL) : NULL;
    if (thread)
        g_thread_unref(thread);
    else
        last_words(data);
}

static void *unref(void *object)
{
    g_object_unref(object);
    return NULL;
}

/** Nothing is written into the slots any more, nor any callback called, when this returns. */
static void give_up_stream(struct aravis *a)
{
    if (!a->stream)
        return;
    take_leave(a, unref, a->stream);
    while (sem_wait(&a->received) && errno == EINTR)
        continue;
    a->stream = NULL;
}

static void *finish(void *data)
{
    struct aravis *a = data;
    if (a->camera)
        g_signal_handlers_disconnect_by_data(arv_camera_get_device(a->camera), a);
    g_clear_object(&a->camera);
    if (a->wake >= 0)
        close(a->wake);
    if (a->left >= 0)
        close(a->left);
    sem_destroy(&a->receiving);
    sem_destroy(&a->received);
    free(a->held);
    free(a);
    return NULL;
}

static void aravis_close(void *priv)
{
    take_leave(priv, finish, priv);
}

static enum ls_err aravis_open(const struct ls_camera_config *config, void **priv,
                               struct ls_camera_info *info, struct ls_diag *diag)
{
    struct aravis *a = calloc(1, sizeof *a);
    if (!a)
        return LS_ERR_NOMEM;
    enum ls_err err = LS_OK;
    strncpy(a->address, config->address, sizeof a->address - 1);
    sem_init(&a->receiving, 0, 0);
    sem_init(&a->received, 0, 0);
    a->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    a->left = eventfd(0, EFD_CLOEXEC);
    if (a->wake < 0 || a->left < 0)
        err = ls_fail(diag, LS_ERR_OS, "camera %s: eventfd: %s", a->address, strerror(errno));
    if (!err)
        err = connect_camera(a, diag);
    if (err) {
        aravis_close(a);
        return err;
    }
    describe_device(a, info);
    *priv = a;
    return LS_OK;
}

/** A camera that shares a slow link sends its packets far apart: one that is not there yet is not
 * lost, and asking for it would only take more of the link. */
static uint32_t packet_timeout_us(const struct ls_camera_config *config)
{
    uint32_t us = PACKETS_LATE * (config->packet_delay_ns / 1000);
    return us > LEAST_PACKET_TIMEOUT_US ? us : LEAST_PACKET_TIMEOUT_US;
}

static enum ls_err aravis_apply(void *priv, const struct ls_camera_config *config,
                                struct ls_camera_info *info, struct ls_diag *diag)
{
    struct aravis *a = priv;
    if (atomic_load(&a->gone))
        return ls_fail(diag, LS_ERR_GONE, "camera %s: control is lost", a->address);
    a->rt_priority = config->rt_priority;
    a->retention_us =
        config->frame_retention_us ? config->frame_retention_us : DEFAULT_RETENTION_US;
    a->packet_timeout_us = packet_timeout_us(config);
    return ls_aravis_apply(a->camera, a->address, config, &a->setup, info, diag);
}

static enum ls_err wait_for_thread(struct aravis *a, struct ls_diag *diag)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += 2;
    while (sem_clockwait(&a->receiving, CLOCK_MONOTONIC, &until))
        if (errno != EINTR)
            return ls_fail(diag, LS_ERR_OS, "camera %s: its receive thread did not start",
                           a->address);
    return LS_OK;
}

static enum ls_err create_stream(struct aravis *a, ArvGvStreamOption options,
                                 struct ls_camera_info *info, struct ls_diag *diag)
{
    GError *error = NULL;
    give_up_stream(a);
    arv_camera_gv_set_stream_options(a->camera, options);
    a->stream = arv_camera_create_stream(a->camera, on_stream, a, &error);
    if (!a->stream)
        return ls_aravis_fail(diag, a->address, "stream", error);
    g_object_set(a->stream, "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
                 "socket-buffer-size", LS_ARAVIS_RECEIVE_BUFFER, "packet-resend",
                 ARV_GV_STREAM_PACKET_RESEND_ALWAYS, "initial-packet-timeout",
                 INITIAL_PACKET_TIMEOUT_US, "packet-timeout", a->packet_timeout_us,
                 "frame-retention", a->retention_us, "packet-request-ratio", 1.0, NULL);
    enum ls_err err = wait_for_thread(a, diag);
    if (err)
        return err;
    info->realtime = atomic_load(&a->realtime);
    uint16_t port = arv_gv_stream_get_port(ARV_GV_STREAM(a->stream));
    ls_aravis_prepare_receive_path(options, port, info);
    return info->packet_socket ? ls_aravis_wait_receive_path(a->address, port, diag) : LS_OK;
}

/** Aravis binds its packet socket before it filters it: what else passes the interface in between
 * (another camera's stream) is taken for ours, and frame ids below those it saw are then thrown
 * away as late. The camera does not send yet, so any packet at all is such a stray; that none comes
 * is known only by listening for a while. */
static bool heard_strays(struct aravis *a)
{
    nanosleep(&(struct timespec){.tv_nsec = SETTLE_MS * 1000000}, NULL);
    return arv_stream_get_info_uint64_by_name(a->stream, "n_received_packets") > 0;
}

/** On an interface that is never quiet UDP does it: its sockets hear nothing but their port. */
static enum ls_err create_clean_stream(struct aravis *a, struct ls_camera_info *info,
                                       struct ls_diag *diag)
{
    for (int attempt = 0; attempt < MAX_ATTEMPTS; attempt++) {
        enum ls_err err = create_stream(a, ARV_GV_STREAM_OPTION_NONE, info, diag);
        if (err || !info->packet_socket || !heard_strays(a))
            return err;
    }
    return create_stream(a, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED, info, diag);
}

static enum ls_err push_slots(struct aravis *a, const struct ls_camera_slots *slots,
                              size_t payload_bytes)
{
    free(a->held);
    a->held = calloc(slots->n, sizeof *a->held);
    a->n_slots = a->held ? slots->n : 0;
    for (uint32_t slot = 0; slot < a->n_slots; slot++)
        arv_stream_push_buffer(a->stream,
                               arv_buffer_new_full(payload_bytes,
                                                   (uint8_t *)slots->base + slot * slots->stride,
                                                   GUINT_TO_POINTER(slot), NULL));
    return a->held ? LS_OK : LS_ERR_NOMEM;
}

static enum ls_err start_acquisition(struct aravis *a, struct ls_diag *diag)
{
    GError *error = NULL;
    arv_camera_start_acquisition(a->camera, &error);
    return error ? ls_aravis_fail(diag, a->address, "AcquisitionStart", error) : LS_OK;
}

static enum ls_err aravis_start(void *priv, const struct ls_camera_slots *slots,
                                struct ls_camera_info *info, struct ls_diag *diag)
{
    struct aravis *a = priv;
    if (atomic_load(&a->gone))
        return ls_fail(diag, LS_ERR_GONE, "camera %s: control is lost", a->address);
    a->raw_id = a->frame_id = 0;
    enum ls_err err = create_clean_stream(a, info, diag);
    if (!err)
        err = push_slots(a, slots, info->payload_bytes);
    if (!err)
        err = start_acquisition(a, diag);
    if (!err)
        err = ls_aravis_watch_start(a->address, a->stream, note_gone, a, &a->watch, diag);
    if (err) {
        give_up_stream(a);
        return err;
    }
    atomic_store(&a->aborted, false);
    atomic_store(&a->stopping, false);
    return LS_OK;
}

static void wait_for_users(struct aravis *a)
{
    eventfd_t ignored;
    atomic_store(&a->stopping, true);
    atomic_store(&a->aborted, true);
    eventfd_write(a->wake, 1);
    while (atomic_load(&a->users))
        eventfd_read(a->left, &ignored);
}

static void read_stats(struct aravis *a, struct ls_camera_stats *stats)
{
    guint64 completed, failed, underruns, resent, missing;
    arv_stream_get_statistics(a->stream, &completed, &failed, &underruns);
    arv_gv_stream_get_statistics(ARV_GV_STREAM(a->stream), &resent, &missing);
    *stats = (struct ls_camera_stats){completed, failed, underruns, resent};
}

static void aravis_stop(void *priv, struct ls_camera_stats *stats)
{
    struct aravis *a = priv;
    wait_for_users(a);
    bool answers = !atomic_load(&a->gone) && ls_aravis_watch_answers(a->watch);
    ls_aravis_watch_stop(a->watch);
    a->watch = NULL;
    if (answers)
        arv_camera_stop_acquisition(a->camera, NULL); /* a refusal changes nothing for us */
    read_stats(a, stats);
    give_up_stream(a);
    for (size_t slot = 0; slot < a->n_slots; slot++) {
        ArvBuffer *buffer = atomic_exchange(&a->held[slot], NULL);
        if (buffer)
            g_object_unref(buffer);
    }
}

/* --- between arm and stop --- */

static enum ls_err fire(struct aravis *a, struct ls_diag *diag)
{
    GError *error = NULL;
    arv_camera_software_trigger(a->camera, &error);
    return error ? ls_aravis_fail(diag, a->address, "TriggerSoftware", error) : LS_OK;
}

static enum ls_err set_exposure(struct aravis *a, double *exposure_us, struct ls_diag *diag)
{
    GError *error = NULL;
    arv_camera_set_exposure_time(a->camera, *exposure_us, &error);
    if (!error)
        *exposure_us = arv_camera_get_exposure_time(a->camera, &error);
    return error ? ls_aravis_fail(diag, a->address, "ExposureTime", error) : LS_OK;
}

static enum ls_err command(struct aravis *a, struct ls_camera_control *control,
                           struct ls_diag *diag)
{
    switch (control->verb) {
    case LS_CAMERA_TRIGGER:
        return fire(a, diag);
    case LS_CAMERA_EXPOSURE:
        return set_exposure(a, &control->exposure_us, diag);
    case LS_CAMERA_LATCH:
        return ls_aravis_latch(a->camera, a->address, &a->setup, control, diag);
    case LS_CAMERA_WAKE:
        break;
    }
    atomic_store(&a->aborted, true);
    eventfd_write(a->wake, 1);
    return LS_OK;
}

static enum ls_err aravis_control(void *priv, struct ls_camera_control *control,
                                  struct ls_diag *diag)
{
    struct aravis *a = priv;
    if (control->verb != LS_CAMERA_WAKE && a->watch && !ls_aravis_watch_answers(a->watch))
        return ls_fail(diag, LS_ERR_GONE, "camera %s: it has fallen silent", a->address);
    enum ls_err err = command(a, control, diag);
    if (err == LS_ERR_GONE)
        note_gone(a);
    return err;
}

const struct ls_camera_ops ls_aravis_ops = {
    .name = "aravis",
    .open = aravis_open,
    .apply = aravis_apply,
    .start = aravis_start,
    .next = aravis_next,
    .release = aravis_release,
    .control = aravis_control,
    .stop = aravis_stop,
    .close = aravis_close,
};
