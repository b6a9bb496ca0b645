/* Messages between flight firmware and the starloop star-sensor stimulator, protocol 1.4, in C99.
 *
 * No allocation, no global state, no library beyond <stdint.h>, <stddef.h> and <string.h>. INTERFACE.md gives every
 * byte. Compile starloop_protocol.c into your program; there is nothing else to build or link. Tests compare it with
 * vectors.json and with the Rust crate.
 *
 * Conventions: little-endian on the wire whatever the processor; quaternion body_from_icrf, Hamilton, scalar first,
 * passive (v_body = q v_icrf conj(q)); rates in body axes; time tags are spacecraft elapsed time in microseconds,
 * modulo 2^32. float must be IEEE 754; double is not used, so that nothing needs more than a single-precision
 * floating-point unit. The bytes and values are those that double precision gives, to the last bit.
 */
#ifndef STARLOOP_PROTOCOL_H
#define STARLOOP_PROTOCOL_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SL_MAJOR 1
#define SL_MINOR 4

/* Message numbers: CAN identifier = base + (number << 4 | node), SYNC without node; the type of a serial packet. The base
 * has SL_EXTENDED for identifiers of 29 bits. */
enum {
    SL_SYNC = 0x08,
    SL_EXPOSURE = 0x18,
    SL_STATUS = 0x19,
    SL_CAMERA_STATUS = 0x1A,
    SL_TIME_FUP = 0x20,
    SL_ATT_Q01 = 0x21, /* 0x21 to 0x25: the classic attitude group; its message is SL_ATTITUDE */
    SL_ATT_Q23 = 0x22,
    SL_ATT_W = 0x23,
    SL_ATT_A = 0x24,
    SL_ATT_T = 0x25,
    SL_WHEELS = 0x28,
    SL_JITTER_PAIR = 0x2A,
    SL_ATTITUDE = 0x30,
    SL_JITTER_BURST = 0x31,
    SL_TABLE = 0x48,
    SL_RESPONSE = 0x58,
    SL_COMMAND = 0x60,
    SL_HEARTBEAT = 0x70
};

/* Why input was refused; the codes of STATUS page 3. */
enum {
    SL_NOT_FINITE = 0,
    SL_QUATERNION_NORM = 1,
    SL_BAD_CRC = 2,
    SL_WRONG_LENGTH = 3,
    SL_TORN_GROUP = 4,
    SL_UNKNOWN_ID = 5,
    SL_UNKNOWN_VALUE = 6,
    SL_WRONG_VERSION = 7,
    SL_REPLAYED_SEQUENCE = 8,
    SL_STALE_TIME = 9,
    SL_FUTURE_TIME = 10,
    SL_BAD_FRAMING = 11,
    SL_OVERSIZE = 12
};

/* What a reader returns: a message, nothing yet, or a rejection. */
#define SL_MESSAGE 1
#define SL_NOTHING 0
#define SL_REJECTED(reason) (-1 - (reason))
#define SL_REASON(result) (-1 - (result))

/* What an encoder returns instead of a count. */
#define SL_ERROR_RANGE (-1)       /* a value that its field cannot carry: nothing is clipped in silence */
#define SL_ERROR_NOT_CARRIED (-2) /* classic CAN does not carry JITTER_FD: send JITTER */

/* Time mark. Its end on the bus is the instant that TIME_FUP with the same counter reports. */
typedef struct {
    uint8_t counter;
} sl_sync;

/* Spacecraft elapsed time at which the SYNC with this counter actually left. */
typedef struct {
    uint32_t seconds;
    uint32_t fraction_2_24; /* 2^-24 s, below 2^24 */
    uint8_t counter;
} sl_time_fup;

#define SL_FLAG_RATE 1         /* the rate was measured; otherwise it is read as zero */
#define SL_FLAG_ACCELERATION 2 /* the acceleration was estimated; otherwise it is read as zero */

typedef struct {
    uint32_t t_us;
    uint8_t seq;   /* counts up by one, wraps */
    uint8_t flags; /* SL_FLAG_... */
    float q_wxyz[4];
    float rate_rad_s[3];          /* classic CAN: 1e-6 rad/s, to 1.048575 */
    float acceleration_rad_s2[3]; /* classic CAN: 1e-6 rad/s^2, to 1.048575 */
} sl_attitude;

#define SL_BURST_MAX 14

/* Jitter: small rotation of the body away from the smooth attitude, about body x and y. */
typedef struct {
    uint32_t t_first_us;
    uint16_t period_us; /* not zero */
    uint8_t seq;        /* counts up by one, wraps */
    uint8_t count;      /* 1 to SL_BURST_MAX */
    float samples_arcsec[SL_BURST_MAX][2]; /* 0.01 arcsec, to 327.67; those beyond count are zero */
} sl_jitter_burst;

/* Two samples 1 ms apart; slot is the SCET of the first in units of 2 ms, modulo 256. */
typedef struct {
    uint8_t slot;
    float samples_arcsec[2][2]; /* 0.02 arcsec, to 163.82 */
} sl_jitter_pair;

typedef struct {
    float speed_rpm[4]; /* 0.25 rpm, to 8191.75 */
} sl_wheels;

typedef struct {
    uint8_t frame;        /* modulo 256 */
    uint8_t attitude_seq; /* newest attitude used */
    uint32_t mid_exposure_us;
    uint32_t age_us; /* of that attitude, in steps of 10; 655350 means that or more */
} sl_exposure;

#define SL_FRAME_JITTER_MISSING 1      /* jitter samples were missing when the frame was drawn */
#define SL_FRAME_PARTLY_EXTRAPOLATED 2 /* part of the exposure lies after the newest attitude, its middle does not */

/* One page; the fields of the other pages are zero. */
typedef struct {
    uint8_t page;
    uint8_t mode;           /* page 0: 0 idle, 1 running, 2 holding, 3 blank, 4 stopped */
    uint16_t frames;        /* page 0 */
    uint32_t latency_us;    /* page 0 */
    int16_t horizon_10us;   /* page 1 */
    float error_arcsec;     /* page 1 */
    int16_t drift_0_1ppm;   /* page 2 */
    int32_t residual_ns;    /* page 2 */
    uint8_t reason;         /* page 3: SL_NOT_FINITE to SL_OVERSIZE */
    uint32_t count;         /* page 3 */
    uint8_t frame;          /* pages 4, 5, 6 */
    uint32_t turns_2_32;    /* pages 4, 5, 6: right ascension, declination, roll; the last two as int32_t */
    uint16_t flags;         /* pages 4, 5, 6: SL_FRAME_..., since protocol 1.3; other bits are reserved */
} sl_status;

/* What started an exposure. */
enum {
    SL_STARTED_BY_RATE = 0,
    SL_STARTED_BY_SOFTWARE = 1,
    SL_STARTED_BY_ACTION = 2,
    SL_STARTED_BY_BUS = 3,
    SL_STARTED_BY_LINE = 4,
    SL_STARTED_BY_CONTROL = 5
};

/* What an exposure of a camera was taken with, since protocol 1.4. One page; the fields of the other pages are zero. */
typedef struct {
    uint8_t page;               /* 0 exposure, 1 levels, 2 trigger */
    uint8_t head;               /* camera head */
    uint8_t frame;              /* modulo 256 */
    uint8_t started_by;         /* page 0: SL_STARTED_BY_... */
    uint32_t exposure_us;       /* page 0 */
    uint16_t gain_cdb;          /* page 1: 0.01 dB beyond the gain of the camera's file */
    uint32_t black_level_dn_16; /* page 1: 1/16 DN, below 2^24 */
    uint32_t delay_us;          /* page 2: from the trigger to the start of the exposure */
} sl_camera_status;

enum { SL_TABLE_LINES = 1, SL_TABLE_PSD = 2, SL_TABLE_WHEEL_HARMONICS = 3 };

typedef struct {
    uint8_t table;
    uint8_t row;
    uint8_t column;
    float value;
} sl_table_cell;

enum {
    SL_HELLO = 1,
    SL_INFO = 2,
    SL_RUN = 3,
    SL_STOP = 4,
    SL_APPLY = 5,
    SL_TRIGGER = 6,
    SL_CAMERA = 7,
    SL_CAMERA_TRIGGER = 8
};

/* What SL_CAMERA sets, and the unit of its value. */
enum {
    SL_CAMERA_EXPOSURE = 1,       /* us */
    SL_CAMERA_GAIN = 2,           /* 0.01 dB beyond the gain of the camera's file */
    SL_CAMERA_BLACK_LEVEL = 3,    /* 1/16 DN */
    SL_CAMERA_FRAME_PERIOD = 4,   /* us; 0: as fast as exposure and readout allow */
    SL_CAMERA_TRIGGERED = 5,      /* 0, 1 */
    SL_CAMERA_TRIGGER_DELAY = 6,  /* us */
    SL_CAMERA_OVERLAP = 7,        /* 0 off, 1 readout, 2 previous frame */
    SL_CAMERA_BURST = 8,          /* exposures of one trigger */
    SL_CAMERA_EXPOSURE_MODE = 9,  /* 0 timed, 1 width of the trigger */
    SL_CAMERA_AUTO_EXPOSURE = 10, /* 0 off, 1 once, 2 continuous */
    SL_CAMERA_AUTO_GAIN = 11,     /* the same */
    SL_CAMERA_REPORT = 12         /* 1: SL_CAMERA_STATUS for each frame of every head; 0: none */
};

#define SL_ALL_HEADS 255

/* The arguments of the other opcodes are zero. */
typedef struct {
    uint8_t opcode;
    uint8_t token;
    uint8_t major, minor;  /* SL_HELLO */
    uint8_t page;          /* SL_INFO */
    uint8_t table, rows;   /* SL_APPLY */
    uint16_t crc16, seed;  /* SL_APPLY */
    uint16_t trigger;      /* SL_TRIGGER */
    uint32_t at_us;        /* SL_TRIGGER, SL_CAMERA_TRIGGER: when it acts; 0 at once */
    uint8_t camera_kind;   /* SL_CAMERA: SL_CAMERA_EXPOSURE to SL_CAMERA_REPORT */
    uint8_t head;          /* SL_CAMERA, SL_CAMERA_TRIGGER: 0 to 15, or SL_ALL_HEADS */
    uint32_t camera_value; /* SL_CAMERA */
} sl_command;

/* Codes of a response. */
enum {
    SL_DONE = 0,
    SL_UNKNOWN_OPCODE = 1,
    SL_WRONG_MAJOR = 2,
    SL_NO_HANDSHAKE = 3,
    SL_UNKNOWN_PAGE = 4,
    SL_TABLE_INCOMPLETE = 5,
    SL_TABLE_CRC = 6,
    SL_TABLE_VALUE = 7,
    SL_NO_TIME_YET = 8,
    SL_TRIGGER_TIME = 9,
    SL_TRIGGERS_FULL = 10,
    SL_UNKNOWN_TRIGGER = 11,
    SL_CAMERA_RANGE = 12,
    SL_CAMERA_UNSUPPORTED = 13,
    SL_UNKNOWN_HEAD = 14,
    SL_CAMERA_FULL = 15
};

/* Bits of capabilities. */
#define SL_CAN_TABLES 1
#define SL_CAN_JITTER 2
#define SL_CAN_WHEELS 4
#define SL_CAN_TRIGGERS 8
#define SL_CAN_CAMERA 16

/* What does not belong to the opcode, and all of it when code is not SL_DONE, is zero. */
typedef struct {
    uint8_t opcode;
    uint8_t token;
    uint8_t code;
    uint8_t major, minor;           /* SL_HELLO */
    uint16_t capabilities;          /* SL_HELLO */
    uint8_t attitude_convention;    /* SL_HELLO: 1 */
    uint8_t page;                   /* SL_INFO */
    uint32_t dbc_crc32;             /* SL_INFO, page 0 */
    uint16_t attitude_hz, jitter_hz; /* SL_INFO, page 1 */
    uint8_t table, rows;            /* SL_APPLY */
    uint16_t trigger;               /* SL_TRIGGER */
    uint8_t late;                   /* SL_TRIGGER, SL_CAMERA_TRIGGER: 1 when its instant was past on arrival: it acts at once */
    uint8_t camera_kind;            /* SL_CAMERA */
    uint8_t head;                   /* SL_CAMERA, SL_CAMERA_TRIGGER */
} sl_response;

typedef struct {
    uint8_t state; /* 0 starting, 1 ready, 2 running, 3 fault */
    uint8_t major;
} sl_heartbeat;

/* One message. `number` says which member holds. */
typedef struct {
    uint8_t number;
    union {
        sl_sync sync;
        sl_time_fup time_fup;
        sl_attitude attitude;
        sl_jitter_burst jitter_burst;
        sl_jitter_pair jitter_pair;
        sl_wheels wheels;
        sl_exposure exposure;
        sl_status status;
        sl_camera_status camera_status;
        sl_table_cell table;
        sl_command command;
        sl_response response;
        sl_heartbeat heartbeat;
    } as;
} sl_message;

/* In a base, and in the identifier of a frame: 29 bits. Without it, 11 bits. As CAN_EFF_FLAG of Linux. */
#define SL_EXTENDED 0x80000000u

/* A data frame. */
typedef struct {
    uint32_t id; /* 11 bits, or SL_EXTENDED and 29 bits */
    uint8_t fd; /* 0 classic, 1 CAN FD */
    uint8_t len;
    uint8_t data[64];
} sl_frame;

#define SL_FRAMES_MAX 5  /* frames of one message: the classic attitude group */
#define SL_SERIAL_MAX 72 /* bytes of one serial packet with its delimiter */

/* CRC-16/IBM-3740 from `crc` (SL_CRC16_START at first) over further bytes. */
#define SL_CRC16_START 0xFFFFu
uint16_t sl_crc16(uint16_t crc, const uint8_t *bytes, size_t len);

/* The CRC of SL_APPLY: from SL_CRC16_START over every value, row by row. */
uint16_t sl_table_crc(uint16_t crc, float value);

/* The payload in one piece; its length, 1 to 64, or SL_ERROR_RANGE. */
int sl_payload_encode(const sl_message *message, uint8_t payload[64]);

/* Reads a payload that came in one piece: SL_MESSAGE or SL_REJECTED. Does not look at sequence numbers. */
int sl_payload_decode(uint8_t number, const uint8_t *payload, size_t len, sl_message *message);

/* The frames of a message in the order to send them; how many, or SL_ERROR_... `fd` 0 makes classic frames only.
 * `base` is a multiple of 16 up to 0x0F0, or SL_EXTENDED and a multiple of 16 up to 0x1FFFF8F0, `node` 0 to 15; otherwise
 * SL_ERROR_RANGE. */
int sl_can_encode(const sl_message *message, int fd, uint32_t base, uint8_t node, sl_frame frames[SL_FRAMES_MAX]);

/* Reads frames of one node: parts of the attitude group not yet committed, newest sequence numbers. */
typedef union {
    struct {
        uint32_t base;
        uint8_t node;
        uint8_t present; /* bit per part */
        uint8_t parts[4][8];
        uint8_t sequences[6];
        uint32_t scet_s; /* whole seconds of the newest SCET */
    } c;
    uint64_t space[8]; /* size and alignment for any implementation */
} sl_can_decoder;

/* 0, or SL_ERROR_RANGE for a base or node that does not exist. */
int sl_can_decoder_init(sl_can_decoder *decoder, uint32_t base, uint8_t node);

/* Reads one frame: SL_MESSAGE, SL_NOTHING (a part of a group was kept) or SL_REJECTED. */
int sl_can_read(sl_can_decoder *decoder, const sl_frame *frame, sl_message *message);

/* Writes one packet with its delimiter and counts `seq` up; bytes written, or SL_ERROR_RANGE. */
int sl_serial_encode(uint8_t *seq, const sl_message *message, uint8_t line[SL_SERIAL_MAX]);

/* Reads a serial line. After any damage it is back in step at the next zero byte. */
typedef union {
    struct {
        uint8_t stuffed[71];
        uint8_t len;
        uint8_t sequences[6];
        uint32_t scet_s;
    } c;
    uint64_t space[16];
} sl_serial_decoder;

void sl_serial_decoder_init(sl_serial_decoder *decoder);

/* Reads one byte: SL_MESSAGE or SL_REJECTED at the delimiter of a packet, otherwise SL_NOTHING. */
int sl_serial_read(sl_serial_decoder *decoder, uint8_t byte, sl_message *message);

#ifdef __cplusplus
}
#endif

#endif
