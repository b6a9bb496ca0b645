/* Encoder and decoder of starloop_protocol.h. INTERFACE.md has the byte tables. */

#include "starloop_protocol.h"

#include <string.h>

#define REPLAY_WINDOW 16
/* Counts per unit of the scaled fields. */
#define RATE_COUNTS 1000000u /* per rad/s, rad/s^2 */
#define RATE_BITS 21
#define PAIR_COUNTS 50u /* per arcsec */
#define PAIR_BITS 14
#define BURST_COUNTS 100u /* per arcsec */
#define SPEED_COUNTS 4u /* per rpm */
/* One in the fixed point of norms, and the squares of (1 - 1e-3) and (1 + 1e-3) of it. */
#define NORM_ONE ((uint32_t)1 << 30)
#define NORM_SQUARE_MIN UINT64_C(1150616814519137889)
#define NORM_SQUARE_MAX UINT64_C(1155228500537565276)

/* --- bytes ------------------------------------------------------------------------------------------------------- */

static void put16(uint8_t *to, uint16_t value) {
    to[0] = (uint8_t)value;
    to[1] = (uint8_t)(value >> 8);
}

static void put32(uint8_t *to, uint32_t value) {
    put16(to, (uint16_t)value);
    put16(to + 2, (uint16_t)(value >> 16));
}

static void put64(uint8_t *to, uint64_t value) {
    put32(to, (uint32_t)value);
    put32(to + 4, (uint32_t)(value >> 32));
}

static uint16_t get16(const uint8_t *from) { return (uint16_t)(from[0] | from[1] << 8); }

static uint32_t get32(const uint8_t *from) { return get16(from) | (uint32_t)get16(from + 2) << 16; }

static uint64_t get64(const uint8_t *from) { return get32(from) | (uint64_t)get32(from + 4) << 32; }

/* Two's complement of any width, without implementation-defined conversions. */
static int32_t sign_extended(uint32_t bits, unsigned width) {
    uint32_t sign = (uint32_t)1 << (width - 1);
    uint32_t low = bits & (sign - 1);
    return bits & sign ? (int32_t)low - (int32_t)(sign - 1) - 1 : (int32_t)low;
}

static void put_float(uint8_t *to, float value) {
    uint32_t bits;
    memcpy(&bits, &value, 4);
    put32(to, bits);
}

static void put_floats(uint8_t *to, const float *values, size_t count) {
    size_t i;
    for (i = 0; i < count; i++) put_float(to + 4 * i, values[i]);
}

/* 0 when a value is NaN or infinite: the exponent is all ones. */
static int get_floats(const uint8_t *from, float *values, size_t count) {
    size_t i;
    int finite = 1;
    for (i = 0; i < count; i++) {
        uint32_t bits = get32(from + 4 * i);
        finite = finite && (bits >> 23 & 0xFF) != 0xFF;
        memcpy(&values[i], &bits, 4);
    }
    return finite;
}

uint16_t sl_crc16(uint16_t crc, const uint8_t *bytes, size_t len) {
    size_t i;
    int bit;
    for (i = 0; i < len; i++) {
        crc = (uint16_t)(crc ^ bytes[i] << 8);
        for (bit = 0; bit < 8; bit++) crc = (uint16_t)(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
    }
    return crc;
}

uint16_t sl_table_crc(uint16_t crc, float value) {
    uint8_t bytes[4];
    put_float(bytes, value);
    return sl_crc16(crc, bytes, 4);
}

/* --- scaled numbers ---------------------------------------------------------------------------------------------- */

/* |value| * scale to the nearest integer, halves up, by integer arithmetic alone: exact on processors whose
 * floating-point unit has single precision only. UINT64_MAX for 2^23 and more, infinities and NaN. */
static uint64_t scaled_magnitude(float value, uint32_t scale) {
    uint32_t bits, exponent, mantissa, shift;
    memcpy(&bits, &value, 4);
    exponent = bits >> 23 & 0xFF;
    mantissa = bits & 0x7FFFFF;
    if (exponent >= 150) return UINT64_MAX;
    if (exponent != 0) mantissa |= 0x800000;
    shift = 150 - (exponent != 0 ? exponent : 1);
    if (shift > 60) return 0;
    return ((uint64_t)mantissa * scale + ((uint64_t)1 << (shift - 1))) >> shift;
}

static int is_negative(float value) {
    uint32_t bits;
    memcpy(&bits, &value, 4);
    return (int)(bits >> 31);
}

/* The nearest count, halves away from zero; 0 when it does not fit or is NaN. */
static int to_counts(float value, uint32_t scale, unsigned bits, int32_t *counts) {
    uint64_t magnitude = scaled_magnitude(value, scale);
    if (magnitude >= (uint64_t)1 << (bits - 1)) return 0;
    *counts = is_negative(value) ? -(int32_t)magnitude : (int32_t)magnitude;
    return 1;
}

/* Packs values from bit `shift` upwards into the word. */
static int pack(const float *values, size_t count, uint32_t scale, unsigned bits, unsigned shift, uint64_t *word) {
    size_t i;
    uint64_t mask = ((uint64_t)1 << bits) - 1;
    for (i = 0; i < count; i++) {
        int32_t counts;
        if (!to_counts(values[i], scale, bits, &counts)) return 0;
        *word |= ((uint64_t)(uint32_t)counts & mask) << (shift + bits * i);
    }
    return 1;
}

/* 0 when a field has its lowest count, which no encoder sends: it has no positive counterpart. */
static int unpack(uint64_t word, uint32_t scale, unsigned bits, unsigned shift, float *values, size_t count) {
    size_t i;
    for (i = 0; i < count; i++) {
        uint32_t field = (uint32_t)(word >> (shift + bits * i)) & (((uint32_t)1 << bits) - 1);
        if (field == (uint32_t)1 << (bits - 1)) return 0;
        values[i] = (float)sign_extended(field, bits) / (float)scale; /* both exact: the nearest float */
    }
    return 1;
}

/* --- attitude ---------------------------------------------------------------------------------------------------- */

static void put_attitude_head(const sl_attitude *attitude, uint8_t head[6]) {
    put32(head, attitude->t_us);
    head[4] = attitude->seq;
    head[5] = attitude->flags & (SL_FLAG_RATE | SL_FLAG_ACCELERATION);
}

static void get_attitude_head(const uint8_t head[6], sl_attitude *attitude) {
    attitude->t_us = get32(head);
    attitude->seq = head[4];
    attitude->flags = head[5] & (SL_FLAG_RATE | SL_FLAG_ACCELERATION);
}

static void put_attitude(const sl_attitude *attitude, uint8_t *to) {
    put_attitude_head(attitude, to);
    put_floats(to + 8, attitude->q_wxyz, 4);
    put_floats(to + 24, attitude->rate_rad_s, 3);
    put_floats(to + 36, attitude->acceleration_rad_s2, 3);
    put16(to + 6, sl_crc16(sl_crc16(SL_CRC16_START, to, 6), to + 8, 40));
}

/* Norm within 1e-3 of 1, decided to 1e-9; squares are compared, so that no square root is needed. */
static int is_unit(const float q[4]) {
    uint64_t square = 0;
    int i;
    for (i = 0; i < 4; i++) {
        uint64_t part = scaled_magnitude(q[i], NORM_ONE);
        if (part > NORM_ONE + (NORM_ONE >> 6)) return 0; /* the sum of squares stays below 2^63 */
        square += part * part;
    }
    return square >= NORM_SQUARE_MIN && square <= NORM_SQUARE_MAX;
}

/* Judges the quaternion; parts that do not hold become zero. */
static int judge_attitude(sl_attitude *attitude) {
    if (!is_unit(attitude->q_wxyz)) return SL_REJECTED(SL_QUATERNION_NORM);
    if (!(attitude->flags & SL_FLAG_RATE)) memset(attitude->rate_rad_s, 0, sizeof attitude->rate_rad_s);
    if (!(attitude->flags & SL_FLAG_ACCELERATION))
        memset(attitude->acceleration_rad_s2, 0, sizeof attitude->acceleration_rad_s2);
    return SL_MESSAGE;
}

static int get_attitude(const uint8_t *from, sl_attitude *attitude) {
    int finite;
    if (sl_crc16(sl_crc16(SL_CRC16_START, from, 6), from + 8, 40) != get16(from + 6)) return SL_REJECTED(SL_BAD_CRC);
    get_attitude_head(from, attitude);
    finite = get_floats(from + 8, attitude->q_wxyz, 4);
    finite = get_floats(from + 24, attitude->rate_rad_s, 3) && finite;
    finite = get_floats(from + 36, attitude->acceleration_rad_s2, 3) && finite;
    return finite ? judge_attitude(attitude) : SL_REJECTED(SL_NOT_FINITE);
}

/* --- jitter, wheels ---------------------------------------------------------------------------------------------- */

static int put_burst(const sl_jitter_burst *burst, uint8_t *to) {
    int i;
    if (burst->period_us == 0 || burst->count == 0 || burst->count > SL_BURST_MAX) return 0;
    put32(to, burst->t_first_us);
    put16(to + 4, burst->period_us);
    to[6] = burst->seq;
    to[7] = burst->count;
    for (i = 0; i < 2 * burst->count; i++) {
        int32_t counts;
        if (!to_counts(burst->samples_arcsec[i / 2][i % 2], BURST_COUNTS, 16, &counts)) return 0;
        put16(to + 8 + 2 * i, (uint16_t)counts);
    }
    return 1;
}

static int get_burst(const uint8_t *from, sl_jitter_burst *burst) {
    int i;
    burst->t_first_us = get32(from);
    burst->period_us = get16(from + 4);
    burst->seq = from[6];
    burst->count = from[7];
    if (burst->period_us == 0 || burst->count == 0 || burst->count > SL_BURST_MAX)
        return SL_REJECTED(SL_UNKNOWN_VALUE);
    for (i = 0; i < 2 * burst->count; i++)
        if (!unpack(get16(from + 8 + 2 * i), BURST_COUNTS, 16, 0, &burst->samples_arcsec[i / 2][i % 2], 1))
            return SL_REJECTED(SL_UNKNOWN_VALUE);
    return SL_MESSAGE;
}

static int put_pair(const sl_jitter_pair *pair, uint8_t *to) {
    uint64_t word = pair->slot;
    if (!pack(&pair->samples_arcsec[0][0], 4, PAIR_COUNTS, PAIR_BITS, 8, &word)) return 0;
    put64(to, word);
    return 1;
}

static int put_wheels(const sl_wheels *wheels, uint8_t *to) {
    uint64_t word = 0;
    if (!pack(wheels->speed_rpm, 4, SPEED_COUNTS, 16, 0, &word)) return 0;
    put64(to, word);
    return 1;
}

/* --- status, tables, commands ------------------------------------------------------------------------------------ */

static int is_status(const sl_status *status) {
    return status->page <= 6 && (status->page != 0 || status->mode <= 4) &&
           (status->page != 3 || status->reason <= SL_OVERSIZE);
}

static int put_status(const sl_status *status, uint8_t *to) {
    if (!is_status(status)) return 0;
    to[0] = status->page;
    switch (status->page) {
    case 0:
        to[1] = status->mode;
        put16(to + 2, status->frames);
        put32(to + 4, status->latency_us);
        break;
    case 1:
        put16(to + 2, (uint16_t)status->horizon_10us);
        put_float(to + 4, status->error_arcsec);
        break;
    case 2:
        put16(to + 2, (uint16_t)status->drift_0_1ppm);
        put32(to + 4, (uint32_t)status->residual_ns);
        break;
    case 3:
        to[1] = status->reason;
        put32(to + 4, status->count);
        break;
    default:
        to[1] = status->frame;
        put16(to + 2, status->flags);
        put32(to + 4, status->turns_2_32);
    }
    return 1;
}

static int get_status(const uint8_t *from, sl_status *status) {
    status->page = from[0];
    switch (status->page) {
    case 0:
        status->mode = from[1];
        status->frames = get16(from + 2);
        status->latency_us = get32(from + 4);
        break;
    case 1:
        status->horizon_10us = (int16_t)sign_extended(get16(from + 2), 16);
        if (!get_floats(from + 4, &status->error_arcsec, 1)) return SL_REJECTED(SL_NOT_FINITE);
        break;
    case 2:
        status->drift_0_1ppm = (int16_t)sign_extended(get16(from + 2), 16);
        status->residual_ns = sign_extended(get32(from + 4), 32);
        break;
    case 3:
        status->reason = from[1];
        status->count = get32(from + 4);
        break;
    default:
        status->frame = from[1];
        status->flags = get16(from + 2);
        status->turns_2_32 = get32(from + 4);
    }
    return is_status(status) ? SL_MESSAGE : SL_REJECTED(SL_UNKNOWN_VALUE);
}

static int is_camera_status(const sl_camera_status *status) {
    if (status->page == 0) return status->started_by <= SL_STARTED_BY_CONTROL;
    return status->page == 2 || (status->page == 1 && status->black_level_dn_16 < (uint32_t)1 << 24);
}

static int put_camera_status(const sl_camera_status *status, uint8_t *to) {
    if (!is_camera_status(status)) return 0;
    to[0] = status->page;
    to[1] = status->head;
    to[2] = status->frame;
    if (status->page == 0) {
        to[3] = status->started_by;
        put32(to + 4, status->exposure_us);
    } else if (status->page == 1) {
        put32(to + 4, status->black_level_dn_16 << 8);
        put16(to + 3, status->gain_cdb);
    } else {
        put32(to + 4, status->delay_us);
    }
    return 1;
}

static int get_camera_status(const uint8_t *from, sl_camera_status *status) {
    status->page = from[0];
    status->head = from[1];
    status->frame = from[2];
    if (status->page == 0) {
        status->started_by = from[3];
        status->exposure_us = get32(from + 4);
    } else if (status->page == 1) {
        status->gain_cdb = get16(from + 3);
        status->black_level_dn_16 = get32(from + 4) >> 8;
    } else {
        status->delay_us = get32(from + 4);
    }
    return is_camera_status(status) ? SL_MESSAGE : SL_REJECTED(SL_UNKNOWN_VALUE);
}

static int is_table(uint8_t table) { return table >= SL_TABLE_LINES && table <= SL_TABLE_WHEEL_HARMONICS; }

static int is_cell(const sl_table_cell *cell) {
    static const uint8_t rows[] = {32, 32, 64}, columns[] = {5, 4, 7};
    return is_table(cell->table) && cell->row < rows[cell->table - 1] && cell->column < columns[cell->table - 1];
}

static int put_cell(const sl_table_cell *cell, uint8_t *to) {
    to[0] = cell->table;
    to[1] = cell->row;
    to[2] = cell->column;
    put_float(to + 4, cell->value);
    return is_cell(cell);
}

static int get_cell(const uint8_t *from, sl_table_cell *cell) {
    int finite = get_floats(from + 4, &cell->value, 1);
    cell->table = from[0];
    cell->row = from[1];
    cell->column = from[2];
    if (!is_cell(cell)) return SL_REJECTED(SL_UNKNOWN_VALUE);
    return finite ? SL_MESSAGE : SL_REJECTED(SL_NOT_FINITE);
}

static void put_command(const sl_command *command, uint8_t *to) {
    to[0] = command->opcode;
    to[1] = command->token;
    if (command->opcode == SL_HELLO) {
        to[2] = command->major;
        to[3] = command->minor;
    } else if (command->opcode == SL_INFO) {
        to[2] = command->page;
    } else if (command->opcode == SL_APPLY) {
        to[2] = command->table;
        to[3] = command->rows;
        put16(to + 4, command->crc16);
        put16(to + 6, command->seed);
    } else if (command->opcode == SL_TRIGGER) {
        put16(to + 2, command->trigger);
        put32(to + 4, command->at_us);
    } else if (command->opcode == SL_CAMERA) {
        to[2] = command->camera_kind;
        to[3] = command->head;
        put32(to + 4, command->camera_value);
    } else if (command->opcode == SL_CAMERA_TRIGGER) {
        to[2] = command->head;
        put32(to + 4, command->at_us);
    }
}

static void get_command(const uint8_t *from, sl_command *command) {
    command->opcode = from[0];
    command->token = from[1];
    if (command->opcode == SL_HELLO) {
        command->major = from[2];
        command->minor = from[3];
    } else if (command->opcode == SL_INFO) {
        command->page = from[2];
    } else if (command->opcode == SL_APPLY) {
        command->table = from[2];
        command->rows = from[3];
        command->crc16 = get16(from + 4);
        command->seed = get16(from + 6);
    } else if (command->opcode == SL_TRIGGER) {
        command->trigger = get16(from + 2);
        command->at_us = get32(from + 4);
    } else if (command->opcode == SL_CAMERA) {
        command->camera_kind = from[2];
        command->head = from[3];
        command->camera_value = get32(from + 4);
    } else if (command->opcode == SL_CAMERA_TRIGGER) {
        command->head = from[2];
        command->at_us = get32(from + 4);
    }
}

static int is_response(const sl_response *response) {
    if (response->code != SL_DONE) return response->code <= SL_CAMERA_FULL;
    if (response->opcode < SL_HELLO || response->opcode > SL_CAMERA_TRIGGER) return 0;
    if (response->opcode == SL_INFO && response->page > 1) return 0;
    return response->opcode != SL_APPLY || is_table(response->table);
}

static int put_response(const sl_response *response, uint8_t *to) {
    if (!is_response(response)) return 0;
    to[0] = response->opcode;
    to[1] = response->token;
    to[2] = response->code;
    if (response->code != SL_DONE) return 1;
    if (response->opcode == SL_HELLO) {
        to[3] = response->major;
        to[4] = response->minor;
        put16(to + 5, response->capabilities);
        to[7] = response->attitude_convention;
    } else if (response->opcode == SL_INFO) {
        to[3] = response->page;
        if (response->page == 0) {
            put32(to + 4, response->dbc_crc32);
        } else {
            put16(to + 4, response->attitude_hz);
            put16(to + 6, response->jitter_hz);
        }
    } else if (response->opcode == SL_APPLY) {
        to[3] = response->table;
        to[4] = response->rows;
    } else if (response->opcode == SL_TRIGGER) {
        put16(to + 3, response->trigger);
        to[5] = response->late ? 1 : 0;
    } else if (response->opcode == SL_CAMERA) {
        to[3] = response->camera_kind;
        to[4] = response->head;
    } else if (response->opcode == SL_CAMERA_TRIGGER) {
        to[3] = response->head;
        to[4] = response->late ? 1 : 0;
    }
    return 1;
}

static int get_response(const uint8_t *from, sl_response *response) {
    response->opcode = from[0];
    response->token = from[1];
    response->code = from[2];
    if (response->code == SL_DONE && response->opcode == SL_HELLO) {
        response->major = from[3];
        response->minor = from[4];
        response->capabilities = get16(from + 5);
        response->attitude_convention = from[7];
    } else if (response->code == SL_DONE && response->opcode == SL_INFO) {
        response->page = from[3];
        if (response->page == 0) {
            response->dbc_crc32 = get32(from + 4);
        } else {
            response->attitude_hz = get16(from + 4);
            response->jitter_hz = get16(from + 6);
        }
    } else if (response->code == SL_DONE && response->opcode == SL_APPLY) {
        response->table = from[3];
        response->rows = from[4];
    } else if (response->code == SL_DONE && response->opcode == SL_TRIGGER) {
        response->trigger = get16(from + 3);
        response->late = from[5] & 1;
    } else if (response->code == SL_DONE && response->opcode == SL_CAMERA) {
        response->camera_kind = from[3];
        response->head = from[4];
    } else if (response->code == SL_DONE && response->opcode == SL_CAMERA_TRIGGER) {
        response->head = from[3];
        response->late = from[4] & 1;
    }
    return is_response(response) ? SL_MESSAGE : SL_REJECTED(SL_UNKNOWN_VALUE);
}

/* --- one payload ------------------------------------------------------------------------------------------------- */

/* Length of the messages that travel in one piece; 0 for other numbers. */
static int payload_len(uint8_t number) {
    switch (number) {
    case SL_SYNC: return 1;
    case SL_HEARTBEAT: return 2;
    case SL_ATTITUDE: return 48;
    case SL_JITTER_BURST: return 64;
    case SL_EXPOSURE:
    case SL_STATUS:
    case SL_CAMERA_STATUS:
    case SL_TIME_FUP:
    case SL_WHEELS:
    case SL_JITTER_PAIR:
    case SL_TABLE:
    case SL_RESPONSE:
    case SL_COMMAND: return 8;
    default: return 0;
    }
}

static void put_exposure(const sl_exposure *exposure, uint8_t *to) {
    uint32_t age = exposure->age_us / 10;
    to[0] = exposure->frame;
    to[1] = exposure->attitude_seq;
    put32(to + 2, exposure->mid_exposure_us);
    put16(to + 6, (uint16_t)(age > 0xFFFF ? 0xFFFF : age));
}

int sl_payload_encode(const sl_message *message, uint8_t payload[64]) {
    int fits = 1;
    memset(payload, 0, 64);
    switch (message->number) {
    case SL_SYNC: payload[0] = message->as.sync.counter; break;
    case SL_TIME_FUP:
        fits = message->as.time_fup.fraction_2_24 < (uint32_t)1 << 24;
        put32(payload, message->as.time_fup.seconds);
        put32(payload + 4, message->as.time_fup.fraction_2_24);
        payload[7] = message->as.time_fup.counter;
        break;
    case SL_ATTITUDE: put_attitude(&message->as.attitude, payload); break;
    case SL_JITTER_BURST: fits = put_burst(&message->as.jitter_burst, payload); break;
    case SL_JITTER_PAIR: fits = put_pair(&message->as.jitter_pair, payload); break;
    case SL_WHEELS: fits = put_wheels(&message->as.wheels, payload); break;
    case SL_EXPOSURE: put_exposure(&message->as.exposure, payload); break;
    case SL_STATUS: fits = put_status(&message->as.status, payload); break;
    case SL_CAMERA_STATUS: fits = put_camera_status(&message->as.camera_status, payload); break;
    case SL_TABLE: fits = put_cell(&message->as.table, payload); break;
    case SL_COMMAND: put_command(&message->as.command, payload); break;
    case SL_RESPONSE: fits = put_response(&message->as.response, payload); break;
    case SL_HEARTBEAT:
        fits = message->as.heartbeat.state <= 3;
        payload[0] = message->as.heartbeat.state;
        payload[1] = message->as.heartbeat.major;
        break;
    default: fits = 0;
    }
    return fits ? payload_len(message->number) : SL_ERROR_RANGE;
}

int sl_payload_decode(uint8_t number, const uint8_t *payload, size_t len, sl_message *message) {
    int wanted = payload_len(number);
    if (wanted == 0) return SL_REJECTED(SL_UNKNOWN_ID);
    if (len != (size_t)wanted) return SL_REJECTED(SL_WRONG_LENGTH);
    memset(message, 0, sizeof *message);
    message->number = number;
    switch (number) {
    case SL_SYNC: message->as.sync.counter = payload[0]; break;
    case SL_TIME_FUP:
        message->as.time_fup.seconds = get32(payload);
        message->as.time_fup.fraction_2_24 = get32(payload + 4) & 0xFFFFFF;
        message->as.time_fup.counter = payload[7];
        break;
    case SL_ATTITUDE: return get_attitude(payload, &message->as.attitude);
    case SL_JITTER_BURST: return get_burst(payload, &message->as.jitter_burst);
    case SL_JITTER_PAIR:
        message->as.jitter_pair.slot = payload[0];
        if (!unpack(get64(payload), PAIR_COUNTS, PAIR_BITS, 8, &message->as.jitter_pair.samples_arcsec[0][0], 4))
            return SL_REJECTED(SL_UNKNOWN_VALUE);
        break;
    case SL_WHEELS:
        if (!unpack(get64(payload), SPEED_COUNTS, 16, 0, message->as.wheels.speed_rpm, 4))
            return SL_REJECTED(SL_UNKNOWN_VALUE);
        break;
    case SL_EXPOSURE:
        message->as.exposure.frame = payload[0];
        message->as.exposure.attitude_seq = payload[1];
        message->as.exposure.mid_exposure_us = get32(payload + 2);
        message->as.exposure.age_us = (uint32_t)get16(payload + 6) * 10;
        break;
    case SL_STATUS: return get_status(payload, &message->as.status);
    case SL_CAMERA_STATUS: return get_camera_status(payload, &message->as.camera_status);
    case SL_TABLE: return get_cell(payload, &message->as.table);
    case SL_COMMAND: get_command(payload, &message->as.command); break;
    case SL_RESPONSE: return get_response(payload, &message->as.response);
    case SL_HEARTBEAT:
        message->as.heartbeat.state = payload[0];
        message->as.heartbeat.major = payload[1];
        return payload[0] <= 3 ? SL_MESSAGE : SL_REJECTED(SL_UNKNOWN_VALUE);
    }
    return SL_MESSAGE;
}

/* Refuses a number received already, or up to 15 behind the newest; further behind, the sender has restarted. It has
 * restarted too when it sends HELLO, or when its SCET runs backwards by a second or more: every number is new then.
 * `sequences` holds (seen, newest) of attitude, bursts and pairs. */
static int admit(uint8_t sequences[6], uint32_t *scet_s, const sl_message *message) {
    uint8_t *seen, seq;
    switch (message->number) {
    case SL_TIME_FUP:
        if (message->as.time_fup.seconds < *scet_s) memset(sequences, 0, 6);
        *scet_s = message->as.time_fup.seconds;
        return SL_MESSAGE;
    case SL_COMMAND:
        if (message->as.command.opcode == SL_HELLO) memset(sequences, 0, 6);
        return SL_MESSAGE;
    case SL_ATTITUDE: seen = sequences, seq = message->as.attitude.seq; break;
    case SL_JITTER_BURST: seen = sequences + 2, seq = message->as.jitter_burst.seq; break;
    case SL_JITTER_PAIR: seen = sequences + 4, seq = message->as.jitter_pair.slot; break;
    default: return SL_MESSAGE;
    }
    if (seen[0] && (uint8_t)(seen[1] - seq) < REPLAY_WINDOW) return SL_REJECTED(SL_REPLAYED_SEQUENCE);
    seen[0] = 1;
    seen[1] = seq;
    return SL_MESSAGE;
}

/* --- CAN --------------------------------------------------------------------------------------------------------- */

static int is_address(uint32_t base, uint8_t node) {
    uint32_t most = base & SL_EXTENDED ? 0x1FFFF8F0u : 0x0F0u;
    return base % 16 == 0 && (base & ~SL_EXTENDED) <= most && node <= 15;
}

static sl_frame frame_of(uint8_t number, uint32_t base, uint8_t node, const uint8_t *data, int len) {
    sl_frame frame;
    memset(&frame, 0, sizeof frame);
    frame.id = base + (uint32_t)(number << 4 | (number == SL_SYNC ? 0 : node));
    frame.fd = len > 8;
    frame.len = (uint8_t)len;
    memcpy(frame.data, data, (size_t)len);
    return frame;
}

/* CRC over the parts that are there, in the order of their numbers, and the first 6 bytes of ATT_T. */
static uint16_t group_crc(uint8_t parts[4][8], unsigned present, const uint8_t head[6]) {
    uint16_t crc = SL_CRC16_START;
    int i;
    for (i = 0; i < 4; i++)
        if (present >> i & 1) crc = sl_crc16(crc, parts[i], 8);
    return sl_crc16(crc, head, 6);
}

static int encode_group(const sl_attitude *attitude, uint32_t base, uint8_t node, sl_frame *frames) {
    uint8_t parts[4][8], commit[8];
    unsigned present = 3u | ((unsigned)attitude->flags & (SL_FLAG_RATE | SL_FLAG_ACCELERATION)) << 2;
    uint64_t rate = 0, acceleration = 0;
    int i, count = 0;
    put_floats(parts[0], attitude->q_wxyz, 2);
    put_floats(parts[1], attitude->q_wxyz + 2, 2);
    if (present & 4 && !pack(attitude->rate_rad_s, 3, RATE_COUNTS, RATE_BITS, 0, &rate)) return SL_ERROR_RANGE;
    if (present & 8 && !pack(attitude->acceleration_rad_s2, 3, RATE_COUNTS, RATE_BITS, 0, &acceleration))
        return SL_ERROR_RANGE;
    put64(parts[2], rate);
    put64(parts[3], acceleration);
    put_attitude_head(attitude, commit);
    put16(commit + 6, group_crc(parts, present, commit));
    for (i = 0; i < 4; i++)
        if (present >> i & 1) frames[count++] = frame_of((uint8_t)(SL_ATT_Q01 + i), base, node, parts[i], 8);
    frames[count++] = frame_of(SL_ATT_T, base, node, commit, 8);
    return count;
}

int sl_can_encode(const sl_message *message, int fd, uint32_t base, uint8_t node, sl_frame frames[SL_FRAMES_MAX]) {
    uint8_t payload[64];
    int len;
    if (!is_address(base, node)) return SL_ERROR_RANGE;
    if (!fd && message->number == SL_ATTITUDE) return encode_group(&message->as.attitude, base, node, frames);
    if (!fd && message->number == SL_JITTER_BURST) return SL_ERROR_NOT_CARRIED;
    len = sl_payload_encode(message, payload);
    if (len < 0) return len;
    frames[0] = frame_of(message->number, base, node, payload, len);
    return 1;
}

int sl_can_decoder_init(sl_can_decoder *decoder, uint32_t base, uint8_t node) {
    memset(decoder, 0, sizeof *decoder);
    decoder->c.base = base;
    decoder->c.node = node;
    return is_address(base, node) ? 0 : SL_ERROR_RANGE;
}

/* A part that is there already belongs to an epoch that was never committed: that one is dropped, this one begins. */
static int keep_part(sl_can_decoder *decoder, int part, const sl_frame *frame) {
    unsigned bit = 1u << part;
    int torn = (decoder->c.present & bit) != 0;
    if (frame->len != 8) return SL_REJECTED(SL_WRONG_LENGTH);
    decoder->c.present = (uint8_t)(torn ? bit : decoder->c.present | bit);
    memcpy(decoder->c.parts[part], frame->data, 8);
    return torn ? SL_REJECTED(SL_TORN_GROUP) : SL_NOTHING;
}

/* Closes the group; leaves no part behind, whatever comes of it. */
static int close_group(sl_can_decoder *decoder, const sl_frame *frame, sl_attitude *attitude) {
    unsigned present = decoder->c.present;
    uint8_t(*parts)[8] = decoder->c.parts;
    decoder->c.present = 0;
    if (frame->len != 8) return SL_REJECTED(SL_WRONG_LENGTH);
    get_attitude_head(frame->data, attitude);
    if (present != (3u | (unsigned)attitude->flags << 2) ||
        group_crc(parts, present, frame->data) != get16(frame->data + 6))
        return SL_REJECTED(SL_TORN_GROUP);
    if (!get_floats(parts[0], attitude->q_wxyz, 2) || !get_floats(parts[1], attitude->q_wxyz + 2, 2))
        return SL_REJECTED(SL_NOT_FINITE);
    if ((present & 4 && !unpack(get64(parts[2]), RATE_COUNTS, RATE_BITS, 0, attitude->rate_rad_s, 3)) ||
        (present & 8 && !unpack(get64(parts[3]), RATE_COUNTS, RATE_BITS, 0, attitude->acceleration_rad_s2, 3)))
        return SL_REJECTED(SL_UNKNOWN_VALUE);
    return judge_attitude(attitude);
}

int sl_can_read(sl_can_decoder *decoder, const sl_frame *frame, sl_message *message) {
    uint32_t offset = frame->id - decoder->c.base, number = offset >> 4; /* of the other length: far off */
    int result;
    if (frame->id < decoder->c.base || number > SL_HEARTBEAT ||
        (offset & 15) != (number == SL_SYNC ? 0u : decoder->c.node))
        return SL_REJECTED(SL_UNKNOWN_ID);
    if (number >= SL_ATT_Q01 && number <= SL_ATT_A) return keep_part(decoder, (int)number - SL_ATT_Q01, frame);
    if (number == SL_ATT_T) {
        memset(message, 0, sizeof *message);
        message->number = SL_ATTITUDE;
        result = close_group(decoder, frame, &message->as.attitude);
    } else {
        result = sl_payload_decode((uint8_t)number, frame->data, frame->len, message);
    }
    return result == SL_MESSAGE ? admit(decoder->c.sequences, &decoder->c.scet_s, message) : result;
}

/* --- serial ------------------------------------------------------------------------------------------------------ */

/* COBS: each zero becomes the distance to the next one. Packets are shorter than the 254 bytes of a full run. */
static size_t stuff(const uint8_t *plain, size_t len, uint8_t *stuffed) {
    size_t i, distance_at = 0, at = 1;
    for (i = 0; i < len; i++) {
        if (plain[i] == 0) {
            stuffed[distance_at] = (uint8_t)(at - distance_at);
            distance_at = at++;
        } else {
            stuffed[at++] = plain[i];
        }
    }
    stuffed[distance_at] = (uint8_t)(at - distance_at);
    return at;
}

/* Decodes in place; returns the plain length, or -1. The input does not contain zeros. */
static int unstuff(uint8_t *bytes, size_t len) {
    size_t from = 0, to = 0;
    while (from < len) {
        size_t run = (size_t)bytes[from] - 1;
        if (run > len - from - 1) return -1;
        memmove(bytes + to, bytes + from + 1, run);
        from += run + 1;
        to += run;
        if (from < len) bytes[to++] = 0;
    }
    return (int)to;
}

int sl_serial_encode(uint8_t *seq, const sl_message *message, uint8_t line[SL_SERIAL_MAX]) {
    uint8_t packet[4 + 64 + 2];
    size_t stuffed;
    int len = sl_payload_encode(message, packet + 4);
    if (len < 0) return len;
    packet[0] = SL_MAJOR;
    packet[1] = message->number;
    packet[2] = (*seq)++;
    packet[3] = (uint8_t)len;
    put16(packet + 4 + len, sl_crc16(SL_CRC16_START, packet, 4 + (size_t)len));
    stuffed = stuff(packet, 4 + (size_t)len + 2, line);
    line[stuffed] = 0;
    return (int)stuffed + 1;
}

void sl_serial_decoder_init(sl_serial_decoder *decoder) { memset(decoder, 0, sizeof *decoder); }

static int open_packet(sl_serial_decoder *decoder, uint8_t *packet, size_t len, sl_message *message) {
    int result;
    if (len < 6 || len != 4 + (size_t)packet[3] + 2) return SL_REJECTED(SL_WRONG_LENGTH);
    if (sl_crc16(SL_CRC16_START, packet, len - 2) != get16(packet + len - 2)) return SL_REJECTED(SL_BAD_CRC);
    if (packet[0] != SL_MAJOR) return SL_REJECTED(SL_WRONG_VERSION);
    result = sl_payload_decode(packet[1], packet + 4, packet[3], message);
    return result == SL_MESSAGE ? admit(decoder->c.sequences, &decoder->c.scet_s, message) : result;
}

int sl_serial_read(sl_serial_decoder *decoder, uint8_t byte, sl_message *message) {
    size_t len = decoder->c.len;
    int plain;
    if (byte != 0) {
        if (len < sizeof decoder->c.stuffed) decoder->c.stuffed[len] = byte;
        if (len <= sizeof decoder->c.stuffed) decoder->c.len++; /* one more than fits marks every longer packet */
        return SL_NOTHING;
    }
    decoder->c.len = 0;
    if (len == 0) return SL_NOTHING;
    if (len > sizeof decoder->c.stuffed) return SL_REJECTED(SL_OVERSIZE);
    plain = unstuff(decoder->c.stuffed, len);
    if (plain < 0) return SL_REJECTED(SL_BAD_FRAMING);
    return open_packet(decoder, decoder->c.stuffed, (size_t)plain, message);
}
