#include "sim/controller_modbus.h"

/** Half a request keeps every other client waiting for so long, then its client is dropped. */
enum { BYTE_TIMEOUT_US = 20000 };

enum ls_err sim_modbus_init(struct sim_modbus *m, modbus_t *context, struct ls_diag *diag)
{
    m->context = context;
    m->map =
        modbus_mapping_new_start_address(0, 0, 0, 0, 0, LS_WIRE_WINDOW + LS_WIRE_WINDOW_SIZE, 0, 0);
    if (!m->context || !m->map)
        return ls_fail(diag, LS_ERR_NOMEM, "controller: out of memory");
    modbus_set_byte_timeout(m->context, 0, BYTE_TIMEOUT_US);
    modbus_set_response_timeout(m->context, 0, BYTE_TIMEOUT_US);
    return LS_OK;
}

void sim_modbus_finish(struct sim_modbus *m)
{
    if (m->context)
        modbus_free(m->context);
    if (m->map)
        modbus_mapping_free(m->map);
}

static unsigned get16(const uint8_t *bytes)
{
    return (unsigned)bytes[0] << 8 | bytes[1];
}

static int do_read(struct sim_modbus *m, struct sim_controller *c, unsigned address, unsigned n)
{
    if (n < 1 || n > MODBUS_MAX_READ_REGISTERS)
        return SIM_ANSWER_VALUE;
    if (address + n > (unsigned)m->map->nb_registers)
        return SIM_ANSWER_ADDRESS;
    return sim_controller_read(c, address, m->map->tab_registers + address, n);
}

static int do_write(struct sim_controller *c, unsigned address, const uint8_t *bytes, unsigned n)
{
    uint16_t regs[MODBUS_MAX_WRITE_REGISTERS];
    if (n < 1 || n > MODBUS_MAX_WRITE_REGISTERS)
        return SIM_ANSWER_VALUE;
    ls_wire_get_registers(bytes, n, regs);
    return sim_controller_write(c, address, regs, n);
}

/** Act on a request's PDU of @length bytes. */
static int act(struct sim_modbus *m, struct sim_controller *c, const uint8_t *pdu, int length)
{
    if (length < 5)
        return SIM_ANSWER_FUNCTION;
    unsigned address = get16(pdu + 1), n = get16(pdu + 3);
    if (pdu[0] == MODBUS_FC_READ_HOLDING_REGISTERS)
        return do_read(m, c, address, n);
    if (pdu[0] == MODBUS_FC_WRITE_SINGLE_REGISTER)
        return do_write(c, address, pdu + 3, 1);
    if (pdu[0] == MODBUS_FC_WRITE_MULTIPLE_REGISTERS) {
        if (length < 6 || pdu[5] != 2 * n || length < 6 + 2 * (int)n)
            return SIM_ANSWER_VALUE;
        return do_write(c, address, pdu + 6, n);
    }
    if (pdu[0] == MODBUS_FC_WRITE_AND_READ_REGISTERS) {
        unsigned n_write = length >= 10 ? get16(pdu + 7) : 0;
        if (length < 10 || pdu[9] != 2 * n_write || length < 10 + 2 * (int)n_write)
            return SIM_ANSWER_VALUE;
        int rc = do_write(c, get16(pdu + 5), pdu + 10, n_write);
        return rc ? rc : do_read(m, c, address, n);
    }
    return SIM_ANSWER_FUNCTION;
}

int sim_modbus_receive(struct sim_modbus *m, uint8_t *request)
{
    return modbus_receive(m->context, request);
}

int sim_modbus_act(struct sim_modbus *m, struct sim_controller *c, const uint8_t *request,
                   int length)
{
    int header = modbus_get_header_length(m->context);
    unsigned unit = request[header - 1];
    if (unit != c->config.unit && unit != MODBUS_TCP_SLAVE)
        return SIM_ANSWER_NOT_ME;
    pthread_mutex_lock(&c->lock);
    int rc = act(m, c, request + header, length - header);
    pthread_mutex_unlock(&c->lock);
    return rc;
}

int sim_modbus_answer(struct sim_modbus *m, const uint8_t *request, int length, int act)
{
    return act ? modbus_reply_exception(m->context, request, (unsigned)act)
               : modbus_reply(m->context, request, length, m->map);
}
