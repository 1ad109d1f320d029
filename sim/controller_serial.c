#include "sim/controller_modbus.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <termios.h>
#include <unistd.h>

enum { BITS_PER_BYTE = 10, /* start, 8 data, stop */ EMPTY_PDU = 4 /* unit, function, CRC */ };

struct serial {
    struct sim_modbus modbus;
    int line;  /* our end of a pseudo-terminal */
    int other; /* the other end, kept open so that the line outlives its users */
};

/** A pseudo-terminal has no baud rate: the time @bytes take. False when told to quit. */
static bool pace(struct sim_controller *c, double bytes, double late_ms)
{
    uint64_t end_ns = sim_now_ns() + (uint64_t)(bytes * BITS_PER_BYTE * 1e9 / c->config.baud) +
                      (uint64_t)(late_ms * 1e6);
    pthread_mutex_lock(&c->lock);
    while (!c->quit && sim_now_ns() < end_ns)
        sim_controller_wait(c, end_ns);
    bool quit = c->quit;
    pthread_mutex_unlock(&c->lock);
    return !quit;
}

static unsigned answer_bytes(const uint8_t *request)
{
    unsigned function = request[1], n = (unsigned)request[4] << 8 | request[5];
    bool reads = function == MODBUS_FC_READ_HOLDING_REGISTERS ||
                 function == MODBUS_FC_WRITE_AND_READ_REGISTERS;
    return EMPTY_PDU + (reads ? 1 + 2 * (n < SIM_MAX_REGISTERS ? n : 0) : 4);
}

/** Does this answer suffer? In *ms the fault's value, or 0. */
static bool suffers(struct sim_controller *c, enum sim_controller_fault_kind kind, double *ms)
{
    pthread_mutex_lock(&c->lock);
    const struct sim_controller_fault *fault =
        c->fired ? sim_controller_due_from(c, kind, c->fired - 1) : NULL;
    *ms = fault ? fault->value : 0;
    pthread_mutex_unlock(&c->lock);
    return fault;
}

/** As long as the true answer, and begun like it: only its end shows that it is none. */
static void answer_damaged(struct serial *serial, const uint8_t *request)
{
    uint8_t answer[MODBUS_MAX_ADU_LENGTH];
    unsigned n = answer_bytes(request);
    memset(answer, 0x5a, sizeof answer);
    memcpy(answer, request, 2);
    answer[2] = (uint8_t)(n - EMPTY_PDU - 1);
    (void)!write(serial->line, answer, n < sizeof answer ? n : sizeof answer);
}

/** A controller that answers nothing lets requests pass. */
static bool lets_pass(struct sim_controller *c)
{
    pthread_mutex_lock(&c->lock);
    bool dead = sim_controller_is_dead(c);
    pthread_mutex_unlock(&c->lock);
    return dead;
}

static void serve_one(struct sim_controller *c, struct serial *serial)
{
    uint8_t request[MODBUS_MAX_ADU_LENGTH];
    int length = sim_modbus_receive(&serial->modbus, request);
    if (length <= 0) {
        modbus_flush(serial->modbus.context);
        return;
    }
    if (!pace(c, length, 0) || lets_pass(c))
        return;
    int act = sim_modbus_act(&serial->modbus, c, request, length);
    double late_ms, unused;
    (void)suffers(c, SIM_CONTROLLER_LATE, &late_ms);
    if (!pace(c, answer_bytes(request), late_ms))
        return;
    if (suffers(c, SIM_CONTROLLER_DAMAGE_ANSWER, &unused))
        answer_damaged(serial, request);
    else
        (void)!sim_modbus_answer(&serial->modbus, request, length, act);
}

static void serial_serve(struct sim_controller *c)
{
    struct serial *serial = c->wire_data;
    struct pollfd fds[2] = {{c->kick_fd, POLLIN, 0}, {serial->line, POLLIN, 0}};
    eventfd_t kicks;
    while (!sim_controller_quitting(c) && poll(fds, 2, -1) > 0) {
        if (fds[0].revents)
            eventfd_read(c->kick_fd, &kicks);
        if (fds[1].revents)
            serve_one(c, serial);
    }
}

static enum ls_err open_line(struct sim_controller *c, struct serial *serial, struct ls_diag *diag)
{
    struct termios raw;
    serial->line = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (serial->line < 0 || grantpt(serial->line) || unlockpt(serial->line) ||
        ptsname_r(serial->line, c->path, sizeof c->path))
        return ls_fail(diag, LS_ERR_OS, "controller: pseudo-terminal: %s", strerror(errno));
    serial->other = open(c->path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (serial->other < 0 || tcgetattr(serial->other, &raw))
        return ls_fail(diag, LS_ERR_OS, "controller: %s: %s", c->path, strerror(errno));
    cfmakeraw(&raw);
    if (tcsetattr(serial->other, TCSANOW, &raw))
        return ls_fail(diag, LS_ERR_OS, "controller: %s: %s", c->path, strerror(errno));
    return LS_OK;
}

static enum ls_err serial_open(struct sim_controller *c, struct ls_diag *diag)
{
    struct serial *serial = c->wire_data = calloc(1, sizeof *serial);
    if (!serial)
        return ls_fail(diag, LS_ERR_NOMEM, "controller: out of memory");
    serial->line = serial->other = -1;
    enum ls_err err = open_line(c, serial, diag);
    if (!err)
        err = sim_modbus_init(&serial->modbus, modbus_new_rtu(c->path, 115200, 'N', 8, 1), diag);
    if (!err) {
        modbus_set_slave(serial->modbus.context, (int)c->config.unit);
        modbus_set_socket(serial->modbus.context, serial->line);
    }
    return err;
}

static void serial_close(struct sim_controller *c)
{
    struct serial *serial = c->wire_data;
    if (!serial)
        return;
    sim_modbus_finish(&serial->modbus);
    if (serial->line >= 0)
        close(serial->line);
    if (serial->other >= 0)
        close(serial->other);
    free(serial);
}

const struct sim_wire sim_wire_serial = {
    .open = serial_open,
    .serve = serial_serve,
    .close = serial_close,
};
