/* A flight computer that commands a slew of 5 deg about body x at 0.5 deg/s, 100 Hz, over CAN.
 * Give it your driver's send function and clock; see INTERFACE.md for the handshake that comes first. */
#include <math.h>

#include "starloop_protocol.h"

int send_slew(int fd, void (*send)(const sl_frame *), uint32_t (*wait_until_next_10_ms_us)(void)) {
    const float rate_rad_s = 0.0087266463f; /* 0.5 deg/s */
    sl_message message = {SL_ATTITUDE, {{0}}};
    int step, i, count;
    for (step = 0; step <= 1000; step++) {
        float half_rad = 0.5f * rate_rad_s * 0.01f * (float)step;
        sl_frame frames[SL_FRAMES_MAX];
        message.as.attitude.t_us = wait_until_next_10_ms_us();
        message.as.attitude.seq = (uint8_t)step;
        message.as.attitude.flags = SL_FLAG_RATE;
        /* body_from_icrf, passive: a body turned by +angle about x sees the sky turned by -angle. */
        message.as.attitude.q_wxyz[0] = cosf(half_rad);
        message.as.attitude.q_wxyz[1] = -sinf(half_rad);
        message.as.attitude.rate_rad_s[0] = rate_rad_s;
        count = sl_can_encode(&message, fd, 0, 0, frames);
        if (count < 0) return count;
        for (i = 0; i < count; i++) send(&frames[i]);
    }
    return 0;
}
