/* CAN_RAW where the kernel has no CAN: a packet socket on an Ethernet interface that carries the kernel's CAN frames.
 *
 * struct can_frame (16 bytes) and struct canfd_frame (72) travel as they are. Whoever is on the interface sees what the
 * others send there on its way out, which is how the kernel hands CAN frames from socket to socket; what comes in, from
 * the other end of a veth pair, is not looked at. A frame's protocol says whose it is (TAG_...). What a socket wants to
 * hear is its filter, a program for the kernel that also holds the options, as numbers that are never executed; what is
 * needed at each frame is in its SO_RCVLOWAT, which nothing else uses on such a socket. So all is with the socket.
 */
#include "preload.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <linux/filter.h>
#include <linux/if_packet.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

/* Of socketcan.py too. OWN: also for its sender, whose number is in the lower bits. HUSHED: loopback is off, so that only
 * the bus hears it. */
enum { TAG_LOCAL = 0x000c, TAG_BUS = 0x00fa, TAG_HUSHED = 0x00fb, TAG_OWN = 0x8000 };

enum { FD = 1, HUSHED = 2, OWN = 4, JOIN = 8 };
enum { OURS = 0x2c << 24, INDEX = 0xffff, FLAGS = 16 }; /* of SO_RCVLOWAT */
enum { MAGIC = 0x7ac7ca01, NAME_LENGTH = 8 };

struct options {
    unsigned flags;
    can_err_mask_t errors;
    unsigned count;
    struct can_filter filters[CAN_RAW_FILTER_MAX];
};

static bool used; /* whether this process has ever made such a socket: the others pay nothing */

static int fail(int number) {
    errno = number;
    return -1;
}

int can_state(int fd) {
    int state = 0, before = errno;
    socklen_t length = sizeof state;
    if (!used) return 0;
    if (REAL(getsockopt)(fd, SOL_SOCKET, SO_RCVLOWAT, &state, &length) || (state & 0xff << 24) != OURS) state = 0;
    errno = before;
    return state;
}

/* -- what a socket hears -------------------------------------------------------------------------------------------- */

enum { LONGEST = 32 + CAN_RAW_FILTER_MAX * 6 };

struct program {
    struct sock_filter lines[LONGEST];
    unsigned short count;
};

static void add(struct program *to, uint16_t code, uint8_t yes, uint8_t no, uint32_t value) {
    to->lines[to->count++] = (struct sock_filter){code, yes, no, value};
}

/* As the kernel lays a filter out: the identifier is in the byte order of the machine, and the program loads big ones. */
static void add_filter(struct program *to, const struct can_filter *filter, bool join) {
    uint32_t mask = filter->can_mask, inverse = filter->can_id & CAN_INV_FILTER;
    if (mask & CAN_EFF_FLAG && !(filter->can_id & CAN_EFF_FLAG)) mask &= CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG;
    bool leave_if_equal = !inverse != join;
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, 0);
    add(to, BPF_ALU | BPF_AND | BPF_K, 0, 0, htonl(mask));
    add(to, BPF_JMP | BPF_JEQ | BPF_K, !leave_if_equal, leave_if_equal, htonl(filter->can_id & mask));
    add(to, BPF_RET | BPF_K, 0, 0, join ? 0 : UINT16_MAX);
}

static void compile(const struct options *wanted, struct program *to) {
    bool join = wanted->flags & JOIN, of_data = true;
    to->count = 0;
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, SKF_AD_OFF + SKF_AD_PKTTYPE);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 1, 0, PACKET_OUTGOING);
    add(to, BPF_RET | BPF_K, 0, 0, 0);
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, SKF_AD_OFF + SKF_AD_PROTOCOL);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 3, 0, TAG_LOCAL);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 2, 0, TAG_BUS);
    add(to, BPF_JMP | BPF_JSET | BPF_K, 1, 0, TAG_OWN);
    add(to, BPF_RET | BPF_K, 0, 0, 0);
    add(to, BPF_LD | BPF_W | BPF_LEN, 0, 0, 0);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 2, 0, CAN_MTU);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 1, 0, wanted->flags & FD ? CANFD_MTU : CAN_MTU);
    add(to, BPF_RET | BPF_K, 0, 0, 0);
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, 0);
    add(to, BPF_JMP | BPF_JSET | BPF_K, 0, 1, htonl(CAN_ERR_FLAG));
    unsigned short errors = to->count;
    add(to, BPF_JMP | BPF_JA, 0, 0, 0);
    for (unsigned k = 0; k < wanted->count; k++) {
        bool error = wanted->filters[k].can_mask & CAN_ERR_FLAG;
        if (error) of_data = !join;
        else add_filter(to, &wanted->filters[k], join);
    }
    add(to, BPF_RET | BPF_K, 0, 0, join && wanted->count && of_data ? UINT16_MAX : 0);
    to->lines[errors].k = to->count - errors - 1;
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, 0);
    uint32_t heard = wanted->errors & CAN_ERR_MASK;
    for (unsigned k = 0; k < wanted->count; k++) {
        if (wanted->filters[k].can_mask & CAN_ERR_FLAG) heard |= wanted->filters[k].can_mask & CAN_ERR_MASK;
    }
    if (join && wanted->count > 1) heard = 0; /* no error matches all of several filters */
    add(to, BPF_JMP | BPF_JSET | BPF_K, 1, 0, htonl(heard));
    add(to, BPF_RET | BPF_K, 0, 0, 0);
    add(to, BPF_RET | BPF_K, 0, 0, UINT16_MAX);
    for (unsigned k = 0; k < wanted->count; k++) { /* from here on nothing is executed */
        add(to, BPF_LD | BPF_IMM, 0, 0, wanted->filters[k].can_id);
        add(to, BPF_LD | BPF_IMM, 0, 0, wanted->filters[k].can_mask);
    }
    add(to, BPF_LD | BPF_IMM, 0, 0, wanted->count);
    add(to, BPF_LD | BPF_IMM, 0, 0, wanted->errors);
    add(to, BPF_LD | BPF_IMM, 0, 0, wanted->flags);
    add(to, BPF_RET | BPF_K, 0, 0, MAGIC);
}

static int keep(int fd, const struct options *wanted, unsigned index) {
    struct program *program = malloc(sizeof *program);
    if (!program) return fail(ENOMEM);
    compile(wanted, program);
    struct sock_fprog whole = {program->count, program->lines};
    int state = OURS | (int)(wanted->flags << FLAGS | index);
    int result = REAL(setsockopt)(fd, SOL_SOCKET, SO_ATTACH_FILTER, &whole, sizeof whole);
    if (!result) result = REAL(setsockopt)(fd, SOL_SOCKET, SO_RCVLOWAT, &state, sizeof state);
    free(program);
    return result;
}

static int options_of(int fd, struct options *found) {
    struct program *program = malloc(sizeof *program);
    if (!program) return fail(ENOMEM);
    socklen_t count = LONGEST;
    int result = REAL(getsockopt)(fd, SOL_SOCKET, SO_GET_FILTER, program->lines, &count);
    if (!result && (count < 5 || program->lines[count - 1].k != MAGIC)) result = fail(EBADF);
    if (!result) {
        const struct sock_filter *last = &program->lines[count - 1];
        *found = (struct options){.flags = last[-1].k, .errors = last[-2].k, .count = last[-3].k};
        const struct sock_filter *first = last - 3 - 2 * found->count;
        for (unsigned k = 0; k < found->count; k++) {
            found->filters[k] = (struct can_filter){first[2 * k].k, first[2 * k + 1].k};
        }
    }
    free(program);
    return result;
}

/* -- life ------------------------------------------------------------------------------------------------------------ */

int can_socket(int type, int protocol) {
    if (access(ROOM "/can", F_OK)) { /* nobody asked for CAN without the kernel's */
        int fd = REAL(socket)(PF_CAN, type, protocol);
        if (fd >= 0 || errno != EAFNOSUPPORT) return fd;
    }
    if (protocol < 0 || protocol >= CAN_NPROTO) return fail(EINVAL);
    if (protocol != CAN_RAW) return fail(EPROTONOSUPPORT);
    if ((type & ~(SOCK_CLOEXEC | SOCK_NONBLOCK)) != SOCK_RAW) return fail(EPROTOTYPE);
    int fd = REAL(socket)(AF_PACKET, type, 0);
    if (fd < 0) return fd;
    struct options fresh = {.count = 1}; /* hears all but errors */
    if (keep(fd, &fresh, 0)) {
        int number = errno;
        close(fd);
        return fail(number);
    }
    used = true;
    return fd;
}

/* Whether the keeper has done with an interface: while it makes one, that one is there and down, and not yet described. */
static bool is_made(const char *name) {
    char folder[sizeof "/sys/class/net/" + IFNAMSIZ];
    if (access(ROOM "/network", F_OK)) return true; /* no keeper makes them */
    snprintf(folder, sizeof folder, "/sys/class/net/%.*s", IFNAMSIZ - 1, name);
    return !access(folder, F_OK);
}

/* Whether an interface carries CAN: of those here all but the loopback do. */
static bool carries(int fd, int index) {
    struct ifreq asked = {.ifr_ifindex = index};
    return !REAL(ioctl)(fd, SIOCGIFNAME, &asked) && is_made(asked.ifr_name) &&
           !REAL(ioctl)(fd, SIOCGIFHWADDR, &asked) && asked.ifr_hwaddr.sa_family == ARPHRD_ETHER;
}

int can_bind(int fd, const struct sockaddr *address, socklen_t length) {
    const struct sockaddr_can *asked = (const struct sockaddr_can *)address;
    int state = can_state(fd);
    if (length < NAME_LENGTH || asked->can_family != AF_CAN) return fail(EINVAL);
    int index = asked->can_ifindex;
    if (index && (index > INDEX || !carries(fd, index))) return fail(ENODEV);
    struct sockaddr_ll to = {.sll_family = AF_PACKET, .sll_protocol = htons(3), .sll_ifindex = index}; /* ETH_P_ALL */
    if (REAL(bind)(fd, (struct sockaddr *)&to, sizeof to)) return -1;
    struct ifreq before = {.ifr_ifindex = state & INDEX};
    if (before.ifr_ifindex && REAL(ioctl)(fd, SIOCGIFNAME, &before)) { /* it has gone, and taken the filters along */
        struct options none = {.flags = (unsigned)state >> FLAGS & 0xff};
        return keep(fd, &none, (unsigned)index);
    }
    state = (state & ~INDEX) | index;
    return REAL(setsockopt)(fd, SOL_SOCKET, SO_RCVLOWAT, &state, sizeof state);
}

static void write_address(struct sockaddr *address, socklen_t *length, int index) {
    struct sockaddr_can seen = {.can_family = AF_CAN, .can_ifindex = index < 0 ? 0 : index};
    memcpy(address, &seen, *length < NAME_LENGTH ? *length : NAME_LENGTH);
    *length = NAME_LENGTH;
}

int can_getsockname(int fd, struct sockaddr *address, socklen_t *length) {
    struct sockaddr_ll own = {0};
    socklen_t size = sizeof own;
    if (REAL(getsockname)(fd, (struct sockaddr *)&own, &size)) return -1;
    write_address(address, length, own.sll_ifindex);
    return 0;
}

/* -- options --------------------------------------------------------------------------------------------------------- */

int can_setsockopt(int fd, int level, int option, const void *value, socklen_t length) {
    static const unsigned flags[] = {
        [CAN_RAW_LOOPBACK] = HUSHED, [CAN_RAW_RECV_OWN_MSGS] = OWN, [CAN_RAW_FD_FRAMES] = FD, [CAN_RAW_JOIN_FILTERS] = JOIN};
    if (level != SOL_CAN_RAW) return REAL(setsockopt)(fd, level, option, value, length);
    struct options *wanted = malloc(sizeof *wanted);
    if (!wanted) return fail(ENOMEM);
    int number = options_of(fd, wanted) ? errno : 0;
    switch (option) {
        case CAN_RAW_FILTER:
            if (length % sizeof(struct can_filter) || length > sizeof wanted->filters) number = EINVAL;
            if (number) break;
            wanted->count = length / sizeof(struct can_filter);
            if (length) memcpy(wanted->filters, value, length);
            break;
        case CAN_RAW_ERR_FILTER:
            if (length != sizeof wanted->errors) number = EINVAL;
            else memcpy(&wanted->errors, value, length);
            break;
        case CAN_RAW_LOOPBACK:
        case CAN_RAW_RECV_OWN_MSGS:
        case CAN_RAW_FD_FRAMES:
        case CAN_RAW_JOIN_FILTERS:
            if (length != sizeof(int)) number = EINVAL;
            else if (!*(const int *)value == (option == CAN_RAW_LOOPBACK)) wanted->flags |= flags[option];
            else wanted->flags &= ~flags[option];
            break;
        default: number = ENOPROTOOPT;
    }
    int result = number ? fail(number) : keep(fd, wanted, (unsigned)can_state(fd) & INDEX);
    free(wanted);
    return result;
}

static int answer(void *value, socklen_t *length, const void *found, size_t size) {
    if (*length > size) *length = (socklen_t)size;
    memcpy(value, found, *length);
    return 0;
}

int can_getsockopt(int fd, int level, int option, void *value, socklen_t *length) {
    if (level == SOL_SOCKET && option == SO_DOMAIN) return answer(value, length, &(int){PF_CAN}, sizeof(int));
    if (level == SOL_SOCKET && option == SO_PROTOCOL) return answer(value, length, &(int){0}, sizeof(int));
    if (level != SOL_CAN_RAW) return REAL(getsockopt)(fd, level, option, value, length);
    struct options *found = malloc(sizeof *found);
    if (!found) return fail(ENOMEM);
    int result = options_of(fd, found);
    unsigned flags = result ? 0 : found->flags;
    size_t size = result ? 0 : found->count * sizeof(struct can_filter);
    if (!result) switch (option) {
        case CAN_RAW_FILTER:
            if (*length < size) {
                *length = (socklen_t)size;
                result = fail(ERANGE);
            } else result = answer(value, length, found->filters, size);
            break;
        case CAN_RAW_ERR_FILTER: result = answer(value, length, &found->errors, sizeof found->errors); break;
        case CAN_RAW_LOOPBACK: result = answer(value, length, &(int){!(flags & HUSHED)}, sizeof(int)); break;
        case CAN_RAW_RECV_OWN_MSGS: result = answer(value, length, &(int){!!(flags & OWN)}, sizeof(int)); break;
        case CAN_RAW_FD_FRAMES: result = answer(value, length, &(int){!!(flags & FD)}, sizeof(int)); break;
        case CAN_RAW_JOIN_FILTERS: result = answer(value, length, &(int){!!(flags & JOIN)}, sizeof(int)); break;
        default: result = fail(ENOPROTOOPT);
    }
    free(found);
    return result;
}

int can_ioctl(int fd, unsigned long request, void *argument) {
    int result = REAL(ioctl)(fd, request, argument);
    struct ifreq *asked = argument;
    if (result) return result;
    if (request == SIOCGIFMTU) asked->ifr_mtu = asked->ifr_mtu < (int)CANFD_MTU ? (int)CAN_MTU : (int)CANFD_MTU;
    if (request == SIOCGIFHWADDR && asked->ifr_hwaddr.sa_family == ARPHRD_ETHER) {
        asked->ifr_hwaddr = (struct sockaddr){.sa_family = ARPHRD_CAN};
    }
    return result;
}

/* -- frames out ------------------------------------------------------------------------------------------------------ */

/* 15 bits that tell this socket from others. */
static unsigned number_of(int fd) {
    struct stat seen = {0};
    return fstat(fd, &seen) ? 0 : (unsigned)(seen.st_ino & (TAG_OWN - 1));
}

/* A packet socket never hears what it sends itself. Who wants to, sends through this one. */
static ssize_t send_for(int fd, const void *frame, size_t size, int flags, struct sockaddr_ll *to) {
    static int sender = -1;
    to->sll_protocol = htons(TAG_OWN | number_of(fd));
    for (int tries = 0; tries < 2; tries++) {
        int through = __atomic_load_n(&sender, __ATOMIC_ACQUIRE);
        ssize_t sent = through < 0 ? fail(EBADF)
                                   : REAL(sendto)(through, frame, size, flags, (struct sockaddr *)to, sizeof *to);
        if (sent >= 0 || (errno != EBADF && errno != ENOTSOCK)) return sent; /* the program may close all it can */
        int fresh = REAL(socket)(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0);
        if (fresh < 0) return -1;
        if (!__atomic_compare_exchange_n(&sender, &through, fresh, false, __ATOMIC_ACQ_REL, __ATOMIC_RELAXED)) close(fresh);
    }
    return -1;
}

static bool takes_fd(int fd, int index) {
    struct ifreq asked = {.ifr_ifindex = index};
    return !REAL(ioctl)(fd, SIOCGIFNAME, &asked) && !REAL(ioctl)(fd, SIOCGIFMTU, &asked) &&
           asked.ifr_mtu >= (int)CANFD_MTU;
}

static ssize_t send_frame(int fd, int state, const struct canfd_frame *frame, size_t size, int flags, int index) {
    struct canfd_frame whole;
    if (!index) return fail(ENXIO);
    if (size == CANFD_MTU && state & FD << FLAGS && takes_fd(fd, index)) {
        if (frame->len > CANFD_MAX_DLEN) return fail(EINVAL);
        memcpy(&whole, frame, sizeof whole);
        whole.flags |= CANFD_FDF;
        frame = &whole;
    } else if (size != CAN_MTU || frame->len > CAN_MAX_DLEN) return fail(EINVAL);
    unsigned tag = state & HUSHED << FLAGS ? TAG_HUSHED : TAG_LOCAL;
    struct sockaddr_ll to = {.sll_family = AF_PACKET, .sll_protocol = htons(tag), .sll_ifindex = index};
    if (state & OWN << FLAGS && tag == TAG_LOCAL) return send_for(fd, frame, size, flags, &to);
    ssize_t sent = REAL(sendto)(fd, frame, size, flags, (struct sockaddr *)&to, sizeof to);
    if (sent < 0 && errno == ENETDOWN) { /* now the socket has told it, and does not tell it again when it reads */
        REAL(getsockopt)(fd, SOL_SOCKET, SO_ERROR, &(int){0}, &(socklen_t){sizeof(int)});
        errno = ENETDOWN;
    }
    return sent;
}

ssize_t can_send(int fd, int state, const void *data, size_t size, int flags) {
    return send_frame(fd, state, data, size, flags, state & INDEX);
}

ssize_t can_sendmsg(int fd, int state, const struct msghdr *message, int flags) {
    union { struct canfd_frame frame; char bytes[CANFD_MTU]; } whole;
    int index = state & INDEX;
    size_t size = 0;
    if (message->msg_name) {
        const struct sockaddr_can *to = message->msg_name;
        if (message->msg_namelen < NAME_LENGTH || to->can_family != AF_CAN) return fail(EINVAL);
        index = to->can_ifindex;
    }
    for (size_t k = 0; k < message->msg_iovlen; k++) {
        const struct iovec *part = &message->msg_iov[k];
        if (part->iov_len > sizeof whole - size) return fail(index ? EINVAL : ENXIO);
        memcpy(whole.bytes + size, part->iov_base, part->iov_len);
        size += part->iov_len;
    }
    return send_frame(fd, state, &whole.frame, size, flags, index);
}

int can_sendmmsg(int fd, int state, struct mmsghdr *messages, unsigned count, int flags) {
    unsigned sent = 0;
    for (; sent < count; sent++) {
        ssize_t size = can_sendmsg(fd, state, &messages[sent].msg_hdr, flags);
        if (size < 0) break;
        messages[sent].msg_len = (unsigned)size;
    }
    return sent || !count ? (int)sent : -1;
}

/* -- frames in ------------------------------------------------------------------------------------------------------- */

/* An interface that has gone is another error than one that is down. */
ssize_t can_failed(int fd) {
    int state = errno == ENETDOWN ? can_state(fd) : 0;
    struct ifreq asked = {.ifr_ifindex = state & INDEX};
    if (state) errno = REAL(ioctl)(fd, SIOCGIFNAME, &asked) ? ENODEV : ENETDOWN;
    return -1;
}

static void tell(int fd, struct msghdr *message, void *name, socklen_t room, const struct sockaddr_ll *from) {
    unsigned tag = ntohs(from->sll_protocol);
    message->msg_name = name;
    message->msg_namelen = room;
    if (name) write_address(name, &message->msg_namelen, from->sll_ifindex);
    else message->msg_namelen = 0;
    if (tag != TAG_BUS) message->msg_flags |= MSG_DONTROUTE;
    if (tag & TAG_OWN && tag == (TAG_OWN | number_of(fd))) message->msg_flags |= MSG_CONFIRM;
}

ssize_t can_recvmsg(int fd, struct msghdr *message, int flags) {
    struct sockaddr_ll from = {0};
    void *name = message->msg_name;
    socklen_t room = message->msg_namelen;
    message->msg_name = &from;
    message->msg_namelen = sizeof from;
    ssize_t size = REAL(recvmsg)(fd, message, flags);
    if (size < 0 || flags & MSG_ERRQUEUE) {
        message->msg_name = name;
        message->msg_namelen = room;
        return size < 0 ? can_failed(fd) : size;
    }
    tell(fd, message, name, room, &from);
    return size;
}

int can_recvmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags, struct timespec *timeout) {
    enum { AT_ONCE = 64 };
    struct { struct sockaddr_ll from; void *name; socklen_t room; } kept[AT_ONCE];
    if (count > AT_ONCE) count = AT_ONCE;
    for (unsigned k = 0; k < count; k++) {
        struct msghdr *each = &messages[k].msg_hdr;
        kept[k].name = each->msg_name;
        kept[k].room = each->msg_namelen;
        each->msg_name = &kept[k].from;
        each->msg_namelen = sizeof kept[k].from;
    }
    int got = REAL(recvmmsg)(fd, messages, count, flags, timeout);
    for (unsigned k = 0; k < count; k++) {
        struct msghdr *each = &messages[k].msg_hdr;
        if ((int)k < got) tell(fd, each, kept[k].name, kept[k].room, &kept[k].from);
        else {
            each->msg_name = kept[k].name;
            each->msg_namelen = kept[k].room;
        }
    }
    return got < 0 ? (int)can_failed(fd) : got;
}

ssize_t can_recvfrom(int fd, void *data, size_t size, int flags, struct sockaddr *address, socklen_t *length) {
    struct iovec part = {data, size};
    struct msghdr message = {.msg_name = address, .msg_namelen = address ? *length : 0, .msg_iov = &part, .msg_iovlen = 1};
    ssize_t got = can_recvmsg(fd, &message, flags);
    if (got >= 0 && address) *length = message.msg_namelen;
    return got;
}
