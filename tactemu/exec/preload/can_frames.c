/* The frames that a CAN socket sends and receives. */
#include "can.h"

#include <arpa/inet.h>
#include <linux/if_packet.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

/* -- frames out ------------------------------------------------------------------------------------------------------ */

/* Return 15 bits that distinguish this socket from others. */
static unsigned number_of(int fd) {
    struct stat seen = {0};
    return fstat(fd, &seen) ? 0 : (unsigned)(seen.st_ino & (TAG_OWN - 1));
}

/* Send a frame through a second socket: a packet socket never receives its own frames, but with OWN it has to. */
static ssize_t send_for(int fd, const void *frame, size_t size, int flags, struct sockaddr_ll *to) {
    static int sender = -1;
    to->sll_protocol = htons(TAG_OWN | number_of(fd));
    for (int tries = 0; tries < 2; tries++) {
        int through = __atomic_load_n(&sender, __ATOMIC_ACQUIRE);
        ssize_t sent = through < 0 ? fail(EBADF)
                                   : REAL(sendto)(through, frame, size, flags, (struct sockaddr *)to, sizeof *to);
        if (sent >= 0 || (errno != EBADF && errno != ENOTSOCK)) return sent; /* else the program has closed the sender */
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
    struct canfd_frame copy;
    if (!index) return fail(ENXIO);
    if (size == CANFD_MTU && state & FD << FLAGS && takes_fd(fd, index)) {
        if (frame->len > CANFD_MAX_DLEN) return fail(EINVAL);
        memcpy(&copy, frame, sizeof copy);
        copy.flags |= CANFD_FDF;
        frame = &copy;
    } else if (size != CAN_MTU || frame->len > CAN_MAX_DLEN) return fail(EINVAL);
    unsigned tag = state & LOOPBACK_OFF << FLAGS ? TAG_LOOPBACK_OFF : TAG_LOCAL;
    struct sockaddr_ll to = {.sll_family = AF_PACKET, .sll_protocol = htons(tag), .sll_ifindex = index};
    if (state & OWN << FLAGS && tag == TAG_LOCAL) return send_for(fd, frame, size, flags, &to);
    ssize_t sent = REAL(sendto)(fd, frame, size, flags, (struct sockaddr *)&to, sizeof to);
    if (sent < 0 && errno == ENETDOWN) { /* clear the pending error, which a read would report again */
        REAL(getsockopt)(fd, SOL_SOCKET, SO_ERROR, &(int){0}, &(socklen_t){sizeof(int)});
        errno = ENETDOWN;
    }
    return sent;
}

ssize_t can_send(int fd, int state, const void *data, size_t size, int flags) {
    return send_frame(fd, state, data, size, flags, state & INDEX);
}

ssize_t can_sendmsg(int fd, int state, const struct msghdr *message, int flags) {
    union { struct canfd_frame frame; char bytes[CANFD_MTU]; } copy;
    int index = state & INDEX;
    size_t size = 0;
    if (message->msg_name) {
        const struct sockaddr_can *to = message->msg_name;
        if (message->msg_namelen < NAME_LENGTH || to->can_family != AF_CAN) return fail(EINVAL);
        index = to->can_ifindex;
    }
    for (size_t k = 0; k < message->msg_iovlen; k++) {
        const struct iovec *part = &message->msg_iov[k];
        if (part->iov_len > sizeof copy - size) return fail(index ? EINVAL : ENXIO);
        memcpy(copy.bytes + size, part->iov_base, part->iov_len);
        size += part->iov_len;
    }
    return send_frame(fd, state, &copy.frame, size, flags, index);
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

/* Return -1 after a failed read, with ENODEV if the interface is gone, ENETDOWN if it is down. */
ssize_t can_failed(int fd) {
    int state = errno == ENETDOWN ? can_state(fd) : 0;
    struct ifreq asked = {.ifr_ifindex = state & INDEX};
    if (state) errno = REAL(ioctl)(fd, SIOCGIFNAME, &asked) ? ENODEV : ENETDOWN;
    return -1;
}

static void describe(int fd, struct msghdr *message, void *name, socklen_t room, const struct sockaddr_ll *from) {
    unsigned tag = ntohs(from->sll_protocol);
    message->msg_name = name;
    message->msg_namelen = room;
    if (name) can_write_address(name, &message->msg_namelen, from->sll_ifindex);
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
    describe(fd, message, name, room, &from);
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
        if ((int)k < got) describe(fd, each, kept[k].name, kept[k].room, &kept[k].from);
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
