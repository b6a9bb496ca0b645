/* A client of NASA's generic star tracker, written from its interface alone: 9-byte commands over a UART, 115200 8N1, answers
 * within 50 ms, everything big-endian.
 *
 *   nos3_tracker DEVICE data COUNT PERIOD_MS   asks for the attitude; a line for each answer: q0 q1 q2 q3 valid (q3 is the scalar)
 *   nos3_tracker DEVICE housekeeping COUNT PERIOD_MS   asks for housekeeping; a line for each answer: the counter
 *   nos3_tracker DEVICE command CODE PAYLOAD   sends one command; "echo" when it comes back
 *   nos3_tracker DEVICE broken 0 0             sends a command with a wrong end; "echo" must not come
 *
 * A line "timeout" is printed for each answer that did not come. Exit status 1 when an answer has other bytes than the interface
 * says, 2 when the device cannot be opened.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

enum { COMMAND_BYTES = 9, HOUSEKEEPING_BYTES = 8, DATA_BYTES = 13, TIMEOUT_MS = 50 };

static int open_port(const char *path)
{
    int port = open(path, O_RDWR | O_NOCTTY);
    struct termios line;
    if (port < 0 || tcgetattr(port, &line) != 0)
        return -1;
    cfmakeraw(&line);
    cfsetispeed(&line, B115200);
    cfsetospeed(&line, B115200);
    if (tcsetattr(port, TCSANOW, &line) != 0 || tcflush(port, TCIOFLUSH) != 0)
        return -1;
    return port;
}

/* Reads exactly so many bytes; 0 when they did not come in time. */
static int read_all(int port, uint8_t *bytes, size_t count, int timeout_ms)
{
    size_t have = 0;
    while (have < count) {
        struct pollfd wait = {port, POLLIN, 0};
        if (poll(&wait, 1, timeout_ms) <= 0)
            return 0;
        ssize_t got = read(port, bytes + have, count - have);
        if (got <= 0)
            return 0;
        have += (size_t)got;
    }
    return 1;
}

static int send_command(int port, uint8_t code, uint32_t payload, uint8_t tail)
{
    uint8_t bytes[COMMAND_BYTES] = {0xDE, 0xAD, code, (uint8_t)(payload >> 24), (uint8_t)(payload >> 16),
                                    (uint8_t)(payload >> 8), (uint8_t)payload, 0xBE, tail};
    uint8_t echo[COMMAND_BYTES];
    if (write(port, bytes, sizeof bytes) != (ssize_t)sizeof bytes)
        return 0;
    if (!read_all(port, echo, sizeof echo, TIMEOUT_MS))
        return 0;
    if (memcmp(bytes, echo, sizeof bytes) != 0) {
        fprintf(stderr, "nos3_tracker: the echo differs from the command\n");
        exit(1);
    }
    return 1;
}

static void check_frame(const uint8_t *bytes, size_t count)
{
    if (bytes[0] != 0xDE || bytes[1] != 0xAD || bytes[count - 2] != 0xBE || bytes[count - 1] != 0xEF) {
        fprintf(stderr, "nos3_tracker: an answer without DE AD ... BE EF\n");
        exit(1);
    }
}

static double component(const uint8_t *bytes)
{
    int raw = bytes[0] << 8 | bytes[1];
    return (raw - 32768) / 32767.0;
}

static void ask(int port, int is_data)
{
    uint8_t bytes[DATA_BYTES];
    size_t count = is_data ? DATA_BYTES : HOUSEKEEPING_BYTES;
    if (!send_command(port, is_data ? 2 : 1, 0, 0xEF) || !read_all(port, bytes, count, TIMEOUT_MS)) {
        puts("timeout");
        tcflush(port, TCIFLUSH);
        return;
    }
    check_frame(bytes, count);
    if (is_data)
        printf("%.9f %.9f %.9f %.9f %d\n", component(bytes + 2), component(bytes + 4), component(bytes + 6),
               component(bytes + 8), bytes[10]);
    else
        printf("%u\n", (unsigned)bytes[2] << 24 | bytes[3] << 16 | bytes[4] << 8 | bytes[5]);
}

int main(int argc, char **argv)
{
    if (argc != 5) {
        fprintf(stderr, "nos3_tracker: wanted DEVICE data|housekeeping|command|broken and two numbers\n");
        return 2;
    }
    int port = open_port(argv[1]);
    if (port < 0) {
        fprintf(stderr, "nos3_tracker: %s: %s\n", argv[1], strerror(errno));
        return 2;
    }
    if (strcmp(argv[2], "command") == 0) {
        int has_echo = send_command(port, (uint8_t)atoi(argv[3]), (uint32_t)strtoul(argv[4], NULL, 10), 0xEF);
        puts(has_echo ? "echo" : "timeout");
        return 0;
    }
    if (strcmp(argv[2], "broken") == 0) {
        puts(send_command(port, 2, 0, 0xEE) ? "echo" : "timeout");
        return 0;
    }
    for (int i = 0; i < atoi(argv[3]); i++) {
        struct timespec pause = {atoi(argv[4]) / 1000, (atoi(argv[4]) % 1000) * 1000000L};
        ask(port, strcmp(argv[2], "data") == 0);
        fflush(stdout);
        nanosleep(&pause, NULL);
    }
    return 0;
}
