/* What the files of CAN share: can.c has the sockets and their options, can_filter.c their filters, can_frames.c the
 * frames that they send and receive.
 *
 * struct can_frame (16 bytes) and struct canfd_frame (72) travel as they are. A packet socket on an interface sees what
 * the others send there on its way out, which is how the kernel hands CAN frames from socket to socket; what comes in,
 * from the other end of a veth pair, is ignored. The protocol of a packet names its sender (TAG_...). A socket holds its
 * own state: its filter is a program for the kernel, with the options behind it as numbers that are never executed;
 * SO_RCVLOWAT, which has no other use on such a socket, holds what is needed at each frame.
 */
#ifndef TACTEMU_CAN_H
#define TACTEMU_CAN_H

#include "preload.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <stdint.h>

/* The protocols of packets, as in network.py. OWN: the sender receives it, too, whose number is in the lower bits.
 * LOOPBACK_OFF: only the bus receives it. */
enum { TAG_LOCAL = 0x000c, TAG_BUS = 0x00fa, TAG_LOOPBACK_OFF = 0x00fb, TAG_OWN = 0x8000 };

enum { FD = 1, LOOPBACK_OFF = 2, OWN = 4, JOIN = 8 }; /* the options of a socket that are switches */
enum { OURS = 0x2c << 24, INDEX = 0xffff, FLAGS = 16 }; /* mark, interface and shift of the switches in SO_RCVLOWAT */
enum { NAME_LENGTH = 8 }; /* the shortest address that the kernel accepts */

struct options {
    unsigned flags;
    can_err_mask_t errors;
    unsigned count;
    struct can_filter filters[CAN_RAW_FILTER_MAX];
};

#pragma GCC visibility push(hidden)

/* can_filter.c: write the options of a socket, and the interface that it is bound to, and read the options. */
int can_write_options(int fd, const struct options *wanted, unsigned index);
int can_read_options(int fd, struct options *found);

/* can.c */
void can_write_address(struct sockaddr *address, socklen_t *length, int index);

#pragma GCC visibility pop

static inline int fail(int number) {
    errno = number;
    return -1;
}

#endif
