/* One command per line on stdin, one answer per line on stdout: what starloop_protocol.h makes of it.
 *
 *   encode FD BASE NODE NUMBER VALUE...   -> ID:HEX ID:HEX ... | error CODE
 *   line SEQ NUMBER VALUE...              -> HEX | error CODE
 *   listen BASE NODE                      -> ok | error CODE     (forgets all frames and serial bytes)
 *   frame ID FD HEX|-                     -> outcome
 *   bytes HEX|-                           -> outcomes of the packets, separated by ;
 *
 * An outcome is `message NUMBER VALUE...`, `nothing` or `rejected REASON`. Values are in the order of the structures.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "starloop_protocol.h"

#define VALUES_MAX 40

static char text[1 << 16];
static sl_can_decoder can;
static sl_serial_decoder serial;

static size_t from_hex(const char *hex, uint8_t *bytes) {
    size_t count = 0;
    unsigned byte;
    while (*hex && *hex != '-' && sscanf(hex, "%2x", &byte) == 1) {
        bytes[count++] = (uint8_t)byte;
        hex += 2;
    }
    return count;
}

static void print_hex(const uint8_t *bytes, size_t count) {
    size_t i;
    for (i = 0; i < count; i++) printf("%02x", bytes[i]);
}

/* --- values -> message ------------------------------------------------------------------------------------------- */

static double given[VALUES_MAX];
static size_t next_given;

static double value(void) { return given[next_given++]; }
static uint8_t u8(void) { return (uint8_t)value(); }
static uint16_t u16(void) { return (uint16_t)value(); }
static uint32_t u32(void) { return (uint32_t)value(); }
static int16_t i16(void) { return (int16_t)value(); }

static void floats(float *to, size_t count) {
    size_t i;
    for (i = 0; i < count; i++) to[i] = (float)value();
}

static void read_status(sl_status *status) {
    status->page = u8();
    if (status->page == 0) {
        status->mode = u8();
        status->frames = u16();
        status->latency_us = u32();
    } else if (status->page == 1) {
        status->horizon_10us = i16();
        status->error_arcsec = (float)value();
    } else if (status->page == 2) {
        status->drift_0_1ppm = i16();
        status->residual_ns = (int32_t)value();
    } else if (status->page == 3) {
        status->reason = u8();
        status->count = u32();
    } else {
        status->frame = u8();
        status->turns_2_32 = u32();
        status->flags = u16();
    }
}

static void read_camera_status(sl_camera_status *status) {
    status->page = u8();
    status->head = u8();
    status->frame = u8();
    if (status->page == 0) {
        status->started_by = u8();
        status->exposure_us = u32();
    } else if (status->page == 1) {
        status->gain_cdb = u16();
        status->black_level_dn_16 = u32();
    } else {
        status->delay_us = u32();
    }
}

static void read_response(sl_response *response) {
    response->opcode = u8();
    response->token = u8();
    response->code = u8();
    if (response->code != SL_DONE) return;
    if (response->opcode == SL_HELLO) {
        response->major = u8();
        response->minor = u8();
        response->capabilities = u16();
        response->attitude_convention = u8();
    } else if (response->opcode == SL_INFO) {
        response->page = u8();
        if (response->page == 0) {
            response->dbc_crc32 = u32();
        } else {
            response->attitude_hz = u16();
            response->jitter_hz = u16();
        }
    } else if (response->opcode == SL_APPLY) {
        response->table = u8();
        response->rows = u8();
    } else if (response->opcode == SL_TRIGGER) {
        response->trigger = u16();
        response->late = u8();
    } else if (response->opcode == SL_CAMERA) {
        response->camera_kind = u8();
        response->head = u8();
    } else if (response->opcode == SL_CAMERA_TRIGGER) {
        response->head = u8();
        response->late = u8();
    }
}

static void read_command(sl_command *command) {
    command->opcode = u8();
    command->token = u8();
    if (command->opcode == SL_HELLO) {
        command->major = u8();
        command->minor = u8();
    } else if (command->opcode == SL_INFO) {
        command->page = u8();
    } else if (command->opcode == SL_APPLY) {
        command->table = u8();
        command->rows = u8();
        command->crc16 = u16();
        command->seed = u16();
    } else if (command->opcode == SL_TRIGGER) {
        command->trigger = u16();
        command->at_us = u32();
    } else if (command->opcode == SL_CAMERA) {
        command->camera_kind = u8();
        command->head = u8();
        command->camera_value = u32();
    } else if (command->opcode == SL_CAMERA_TRIGGER) {
        command->head = u8();
        command->at_us = u32();
    }
}

static void read_attitude(sl_attitude *attitude) {
    attitude->t_us = u32();
    attitude->seq = u8();
    attitude->flags = u8();
    floats(attitude->q_wxyz, 4);
    floats(attitude->rate_rad_s, 3);
    floats(attitude->acceleration_rad_s2, 3);
}

/* `NUMBER VALUE...` */
static sl_message read_message(const char *from) {
    sl_message message;
    char *end;
    memset(&message, 0, sizeof message);
    message.number = (uint8_t)strtoul(from, &end, 10);
    memset(given, 0, sizeof given);
    for (next_given = 0; *end == ' ' && next_given < VALUES_MAX; next_given++) given[next_given] = strtod(end, &end);
    next_given = 0;
    switch (message.number) {
    case SL_SYNC: message.as.sync.counter = u8(); break;
    case SL_TIME_FUP:
        message.as.time_fup.seconds = u32();
        message.as.time_fup.fraction_2_24 = u32();
        message.as.time_fup.counter = u8();
        break;
    case SL_ATTITUDE: read_attitude(&message.as.attitude); break;
    case SL_JITTER_BURST:
        message.as.jitter_burst.t_first_us = u32();
        message.as.jitter_burst.period_us = u16();
        message.as.jitter_burst.seq = u8();
        message.as.jitter_burst.count = u8();
        floats(&message.as.jitter_burst.samples_arcsec[0][0], 2 * SL_BURST_MAX);
        break;
    case SL_JITTER_PAIR:
        message.as.jitter_pair.slot = u8();
        floats(&message.as.jitter_pair.samples_arcsec[0][0], 4);
        break;
    case SL_WHEELS: floats(message.as.wheels.speed_rpm, 4); break;
    case SL_EXPOSURE:
        message.as.exposure.frame = u8();
        message.as.exposure.attitude_seq = u8();
        message.as.exposure.mid_exposure_us = u32();
        message.as.exposure.age_us = u32();
        break;
    case SL_STATUS: read_status(&message.as.status); break;
    case SL_CAMERA_STATUS: read_camera_status(&message.as.camera_status); break;
    case SL_TABLE:
        message.as.table.table = u8();
        message.as.table.row = u8();
        message.as.table.column = u8();
        message.as.table.value = (float)value();
        break;
    case SL_COMMAND: read_command(&message.as.command); break;
    case SL_RESPONSE: read_response(&message.as.response); break;
    case SL_HEARTBEAT:
        message.as.heartbeat.state = u8();
        message.as.heartbeat.major = u8();
        break;
    }
    return message;
}

/* --- message -> values ------------------------------------------------------------------------------------------- */

static void print_floats(const float *values, size_t count) {
    size_t i;
    for (i = 0; i < count; i++) printf(" %.9e", (double)values[i]);
}

static void print_status(const sl_status *s) {
    printf(" %u", s->page);
    if (s->page == 0) printf(" %u %u %lu", s->mode, s->frames, (unsigned long)s->latency_us);
    else if (s->page == 1) printf(" %d", s->horizon_10us), print_floats(&s->error_arcsec, 1);
    else if (s->page == 2) printf(" %d %ld", s->drift_0_1ppm, (long)s->residual_ns);
    else if (s->page == 3) printf(" %u %lu", s->reason, (unsigned long)s->count);
    else printf(" %u %lu %u", s->frame, (unsigned long)s->turns_2_32, s->flags);
}

static void print_camera_status(const sl_camera_status *s) {
    printf(" %u %u %u", s->page, s->head, s->frame);
    if (s->page == 0) printf(" %u %lu", s->started_by, (unsigned long)s->exposure_us);
    else if (s->page == 1) printf(" %u %lu", s->gain_cdb, (unsigned long)s->black_level_dn_16);
    else printf(" %lu", (unsigned long)s->delay_us);
}

static void print_response(const sl_response *r) {
    printf(" %u %u %u", r->opcode, r->token, r->code);
    if (r->code != SL_DONE) return;
    if (r->opcode == SL_HELLO) printf(" %u %u %u %u", r->major, r->minor, r->capabilities, r->attitude_convention);
    else if (r->opcode == SL_INFO && r->page == 0) printf(" 0 %lu", (unsigned long)r->dbc_crc32);
    else if (r->opcode == SL_INFO) printf(" %u %u %u", r->page, r->attitude_hz, r->jitter_hz);
    else if (r->opcode == SL_APPLY) printf(" %u %u", r->table, r->rows);
    else if (r->opcode == SL_TRIGGER) printf(" %u %u", r->trigger, r->late);
    else if (r->opcode == SL_CAMERA) printf(" %u %u", r->camera_kind, r->head);
    else if (r->opcode == SL_CAMERA_TRIGGER) printf(" %u %u", r->head, r->late);
}

static void print_command(const sl_command *c) {
    printf(" %u %u", c->opcode, c->token);
    if (c->opcode == SL_HELLO) printf(" %u %u", c->major, c->minor);
    else if (c->opcode == SL_INFO) printf(" %u", c->page);
    else if (c->opcode == SL_APPLY) printf(" %u %u %u %u", c->table, c->rows, c->crc16, c->seed);
    else if (c->opcode == SL_TRIGGER) printf(" %u %lu", c->trigger, (unsigned long)c->at_us);
    else if (c->opcode == SL_CAMERA) printf(" %u %u %lu", c->camera_kind, c->head, (unsigned long)c->camera_value);
    else if (c->opcode == SL_CAMERA_TRIGGER) printf(" %u %lu", c->head, (unsigned long)c->at_us);
}

static void print_attitude(const sl_attitude *a) {
    printf(" %lu %u %u", (unsigned long)a->t_us, a->seq, a->flags);
    print_floats(a->q_wxyz, 4);
    print_floats(a->rate_rad_s, 3);
    print_floats(a->acceleration_rad_s2, 3);
}

static void print_burst(const sl_jitter_burst *b) {
    printf(" %lu %u %u %u", (unsigned long)b->t_first_us, b->period_us, b->seq, b->count);
    print_floats(&b->samples_arcsec[0][0], 2 * (size_t)b->count);
}

static void print_message(const sl_message *message) {
    printf("message %u", message->number);
    switch (message->number) {
    case SL_SYNC: printf(" %u", message->as.sync.counter); break;
    case SL_TIME_FUP:
        printf(" %lu %lu %u", (unsigned long)message->as.time_fup.seconds,
               (unsigned long)message->as.time_fup.fraction_2_24, message->as.time_fup.counter);
        break;
    case SL_ATTITUDE: print_attitude(&message->as.attitude); break;
    case SL_JITTER_BURST: print_burst(&message->as.jitter_burst); break;
    case SL_JITTER_PAIR:
        printf(" %u", message->as.jitter_pair.slot);
        print_floats(&message->as.jitter_pair.samples_arcsec[0][0], 4);
        break;
    case SL_WHEELS: print_floats(message->as.wheels.speed_rpm, 4); break;
    case SL_EXPOSURE:
        printf(" %u %u %lu %lu", message->as.exposure.frame, message->as.exposure.attitude_seq,
               (unsigned long)message->as.exposure.mid_exposure_us, (unsigned long)message->as.exposure.age_us);
        break;
    case SL_STATUS: print_status(&message->as.status); break;
    case SL_CAMERA_STATUS: print_camera_status(&message->as.camera_status); break;
    case SL_TABLE:
        printf(" %u %u %u", message->as.table.table, message->as.table.row, message->as.table.column);
        print_floats(&message->as.table.value, 1);
        break;
    case SL_COMMAND: print_command(&message->as.command); break;
    case SL_RESPONSE: print_response(&message->as.response); break;
    case SL_HEARTBEAT: printf(" %u %u", message->as.heartbeat.state, message->as.heartbeat.major); break;
    }
}

static void print_outcome(int result, const sl_message *message) {
    if (result == SL_MESSAGE) print_message(message);
    else if (result == SL_NOTHING) fputs("nothing", stdout);
    else printf("rejected %d", SL_REASON(result));
}

/* --- commands ---------------------------------------------------------------------------------------------------- */

static void encode(const char *from) {
    int fd, used = 0, count, i;
    unsigned base, node;
    sl_frame frames[SL_FRAMES_MAX];
    sl_message message;
    sscanf(from, "%d %u %u %n", &fd, &base, &node, &used);
    message = read_message(from + used);
    count = sl_can_encode(&message, fd, (uint32_t)base, (uint8_t)node, frames);
    if (count < 0) printf("error %d", count);
    for (i = 0; i < count; i++) {
        printf("%s%0*lX:", i ? " " : "", frames[i].id & SL_EXTENDED ? 8 : 3, (unsigned long)(frames[i].id & ~SL_EXTENDED));
        print_hex(frames[i].data, frames[i].len);
    }
}

static void line(const char *from) {
    int used = 0, count;
    unsigned seq;
    uint8_t number, bytes[SL_SERIAL_MAX];
    sl_message message;
    sscanf(from, "%u %n", &seq, &used);
    number = (uint8_t)seq;
    message = read_message(from + used);
    count = sl_serial_encode(&number, &message, bytes);
    if (count < 0) printf("error %d", count);
    else print_hex(bytes, (size_t)count);
}

static void read_frame(const char *from) {
    unsigned id, fd;
    int used = 0;
    sl_frame frame;
    sl_message message;
    memset(&frame, 0, sizeof frame);
    sscanf(from, "%x %u %n", &id, &fd, &used);
    frame.id = (uint32_t)id;
    frame.fd = (uint8_t)fd;
    frame.len = (uint8_t)from_hex(from + used, frame.data);
    print_outcome(sl_can_read(&can, &frame, &message), &message);
}

static void read_bytes(const char *from) {
    static uint8_t bytes[sizeof text / 2];
    size_t count = from_hex(from, bytes), i;
    sl_message message;
    int any = 0;
    for (i = 0; i < count; i++) {
        int result = sl_serial_read(&serial, bytes[i], &message);
        if (result == SL_NOTHING) continue;
        if (any++) putchar(';');
        print_outcome(result, &message);
    }
    if (!any) fputs("nothing", stdout);
}

static void listen(const char *from) {
    unsigned base, node;
    int error;
    sscanf(from, "%u %u", &base, &node);
    sl_serial_decoder_init(&serial);
    error = sl_can_decoder_init(&can, (uint32_t)base, (uint8_t)node);
    if (error) printf("error %d", error);
    else fputs("ok", stdout);
}

int main(void) {
    while (fgets(text, sizeof text, stdin)) {
        text[strcspn(text, "\n")] = 0;
        if (!strncmp(text, "encode ", 7)) encode(text + 7);
        else if (!strncmp(text, "line ", 5)) line(text + 5);
        else if (!strncmp(text, "listen ", 7)) listen(text + 7);
        else if (!strncmp(text, "frame ", 6)) read_frame(text + 6);
        else if (!strncmp(text, "bytes ", 6)) read_bytes(text + 6);
        else fputs("unknown command", stdout);
        putchar('\n');
    }
    return 0;
}
