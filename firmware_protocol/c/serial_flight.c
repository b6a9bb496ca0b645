/* A whole flight computer on a serial line, for POSIX: handshake, time marks, a slew of 5 deg about body x at 0.5 deg/s.
 *
 *   gcc -std=c99 -o serial_flight serial_flight.c starloop_protocol.c -lm
 *   ./serial_flight /dev/ttyUSB1                    921600 bit/s, 8N1: as link.bit_rate
 *
 * On a board, replace open_line, now_us, wait_until, and the calls of read, write and tcdrain. */
#define _DEFAULT_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "starloop_protocol.h"

#define STEP_US 10000u /* 100 attitudes per second */
#define SLEW_STEPS 1000u
#define HOLD_STEPS 200u

static int line = -1;

static int open_line(const char *path) {
    struct termios settings;
    line = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (line < 0 || tcgetattr(line, &settings) != 0) return -1;
    cfmakeraw(&settings);
    settings.c_cflag |= CLOCAL | CREAD;
    if (cfsetspeed(&settings, B921600) != 0) return -1;
    return tcsetattr(line, TCSANOW, &settings);
}

/* Spacecraft elapsed time, us modulo 2^32; any start. */
static uint32_t now_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)((uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u);
}

static void wait_until(uint32_t at_us) {
    struct timespec short_time = {0, 200000};
    while ((int32_t)(at_us - now_us()) > 0) nanosleep(&short_time, NULL);
}

static uint8_t packets;

static void send_message(const sl_message *message) {
    uint8_t bytes[SL_SERIAL_MAX];
    int sent = 0, count = sl_serial_encode(&packets, message, bytes);
    while (sent < count) {
        ssize_t written = write(line, bytes + sent, (size_t)(count - sent));
        if (written > 0) sent += (int)written;
        if (written < 0 && errno != EAGAIN) {
            perror("serial line");
            exit(1);
        }
    }
}

static sl_serial_decoder decoder;
static unsigned exposures, refused;

/* Reads what has come; 1 when the response to the command with this token is among it. */
static int take_messages(uint8_t token, sl_response *response) {
    uint8_t bytes[256];
    int found = 0;
    ssize_t i, count;
    while ((count = read(line, bytes, sizeof bytes)) > 0) {
        for (i = 0; i < count; i++) {
            sl_message message;
            int result = sl_serial_read(&decoder, bytes[i], &message);
            if (result < 0) refused++;
            if (result != SL_MESSAGE) continue;
            if (message.number == SL_EXPOSURE) exposures++;
            if (message.number == SL_RESPONSE && message.as.response.token == token) {
                *response = message.as.response;
                found = 1;
            }
        }
    }
    return found;
}

/* Sends a command until it is answered, ten times at most; its code, or -1 without an answer. */
static int command(uint8_t opcode, uint8_t token) {
    sl_message message = {SL_COMMAND, {{0}}};
    sl_response response;
    int tries;
    message.as.command.opcode = opcode;
    message.as.command.token = token;
    message.as.command.major = SL_MAJOR;
    message.as.command.minor = SL_MINOR;
    for (tries = 0; tries < 10; tries++) {
        uint32_t end_us = now_us() + 100000u;
        send_message(&message);
        while ((int32_t)(end_us - now_us()) > 0) {
            if (take_messages(token, &response)) return response.code;
            wait_until(now_us() + 1000u);
        }
    }
    return -1;
}

/* A time mark, and the time at which it left. */
static void send_time(uint8_t counter) {
    sl_message mark = {SL_SYNC, {{0}}}, follow_up = {SL_TIME_FUP, {{0}}};
    uint32_t left_us;
    mark.as.sync.counter = counter;
    send_message(&mark);
    tcdrain(line);
    left_us = now_us();
    follow_up.as.time_fup.seconds = left_us / 1000000u;
    follow_up.as.time_fup.fraction_2_24 = (uint32_t)(((uint64_t)(left_us % 1000000u) << 24) / 1000000u);
    follow_up.as.time_fup.counter = counter;
    send_message(&follow_up);
}

static void send_attitude(uint32_t step, uint32_t t_us) {
    const float rate_rad_s = 0.0087266463f; /* 0.5 deg/s */
    const uint32_t turned = step < SLEW_STEPS ? step : SLEW_STEPS;
    const float half_rad = 0.5f * rate_rad_s * 1e-6f * (float)STEP_US * (float)turned;
    sl_message message = {SL_ATTITUDE, {{0}}};
    message.as.attitude.t_us = t_us;
    message.as.attitude.seq = (uint8_t)step;
    message.as.attitude.flags = SL_FLAG_RATE;
    /* body_from_icrf, passive: a body turned by +angle about x sees the sky turned by -angle. */
    message.as.attitude.q_wxyz[0] = cosf(half_rad);
    message.as.attitude.q_wxyz[1] = -sinf(half_rad);
    message.as.attitude.rate_rad_s[0] = step < SLEW_STEPS ? rate_rad_s : 0.0f;
    send_message(&message);
}

int main(int arguments, char **argument) {
    sl_response response;
    uint32_t step, start_us;
    int code;
    if (arguments != 2 || open_line(argument[1]) != 0) {
        fprintf(stderr, "usage: %s /dev/ttyUSB1\n", argument[0]);
        return 2;
    }
    sl_serial_decoder_init(&decoder);
    if ((code = command(SL_HELLO, 1)) != SL_DONE || (code = command(SL_RUN, 2)) != SL_DONE) {
        fprintf(stderr, "no handshake: code %d (-1: no answer)\n", code);
        return 1;
    }
    start_us = now_us();
    for (step = 0; step < SLEW_STEPS + HOLD_STEPS; step++) {
        uint32_t t_us = start_us + step * STEP_US;
        wait_until(t_us);
        if (step % 10 == 0) send_time((uint8_t)(step / 10));
        send_attitude(step, t_us);
        take_messages(0, &response);
    }
    printf("%u exposures reported, %u packets refused\n", exposures, refused);
    return exposures > 0 && refused == 0 ? 0 : 1;
}
