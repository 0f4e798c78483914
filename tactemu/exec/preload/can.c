/* CAN_RAW without CAN in the kernel: packet sockets on an Ethernet interface that carries the kernel's CAN frames. */
#include "can.h"

#include <arpa/inet.h>
#include <linux/if_packet.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

static bool used; /* whether this process has made such a socket: without one, can_state costs nothing */

int can_state(int fd) {
    int state = 0, before = errno;
    socklen_t length = sizeof state;
    if (!used) return 0;
    if (REAL(getsockopt)(fd, SOL_SOCKET, SO_RCVLOWAT, &state, &length) || (state & 0xff << 24) != OURS) state = 0;
    errno = before;
    return state;
}

/* -- life ------------------------------------------------------------------------------------------------------------ */

int can_socket(int type, int protocol) {
    if (access(ROOM "/can", F_OK)) { /* the view has no buses of the preload library */
        int fd = REAL(socket)(PF_CAN, type, protocol);
        if (fd >= 0 || errno != EAFNOSUPPORT) return fd;
    }
    if (protocol < 0 || protocol >= CAN_NPROTO) return fail(EINVAL);
    if (protocol != CAN_RAW) return fail(EPROTONOSUPPORT);
    if ((type & ~(SOCK_CLOEXEC | SOCK_NONBLOCK)) != SOCK_RAW) return fail(EPROTOTYPE);
    int fd = REAL(socket)(AF_PACKET, type, 0);
    if (fd < 0) return fd;
    struct options fresh = {.count = 1}; /* accepts all frames but error frames */
    if (can_write_options(fd, &fresh, 0)) {
        int number = errno;
        close(fd);
        return fail(number);
    }
    used = true;
    return fd;
}

/* Return whether the keeper has finished an interface: before that, it is down and has no folder in sysfs. */
static bool is_made(const char *name) {
    char folder[sizeof "/sys/class/net/" + IFNAMSIZ];
    if (access(ROOM "/network", F_OK)) return true; /* interfaces without a keeper */
    snprintf(folder, sizeof folder, "/sys/class/net/%.*s", IFNAMSIZ - 1, name);
    return !access(folder, F_OK);
}

/* Return whether an interface carries CAN: all interfaces of the view but loopback do. */
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
    if (before.ifr_ifindex && REAL(ioctl)(fd, SIOCGIFNAME, &before)) { /* the interface is gone, with the filters */
        struct options none = {.flags = (unsigned)state >> FLAGS & 0xff};
        return can_write_options(fd, &none, (unsigned)index);
    }
    state = (state & ~INDEX) | index;
    return REAL(setsockopt)(fd, SOL_SOCKET, SO_RCVLOWAT, &state, sizeof state);
}

void can_write_address(struct sockaddr *address, socklen_t *length, int index) {
    struct sockaddr_can seen = {.can_family = AF_CAN, .can_ifindex = index < 0 ? 0 : index};
    memcpy(address, &seen, *length < NAME_LENGTH ? *length : NAME_LENGTH);
    *length = NAME_LENGTH;
}

int can_getsockname(int fd, struct sockaddr *address, socklen_t *length) {
    struct sockaddr_ll own = {0};
    socklen_t size = sizeof own;
    if (REAL(getsockname)(fd, (struct sockaddr *)&own, &size)) return -1;
    can_write_address(address, length, own.sll_ifindex);
    return 0;
}

/* -- options --------------------------------------------------------------------------------------------------------- */

int can_setsockopt(int fd, int level, int option, const void *value, socklen_t length) {
    static const unsigned flags[] = {
        [CAN_RAW_LOOPBACK] = LOOPBACK_OFF,
        [CAN_RAW_RECV_OWN_MSGS] = OWN,
        [CAN_RAW_FD_FRAMES] = FD,
        [CAN_RAW_JOIN_FILTERS] = JOIN,
    };
    if (level != SOL_CAN_RAW) return REAL(setsockopt)(fd, level, option, value, length);
    struct options *wanted = malloc(sizeof *wanted);
    if (!wanted) return fail(ENOMEM);
    int number = can_read_options(fd, wanted) ? errno : 0;
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
    int result = number ? fail(number) : can_write_options(fd, wanted, (unsigned)can_state(fd) & INDEX);
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
    int result = can_read_options(fd, found);
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
        case CAN_RAW_LOOPBACK: result = answer(value, length, &(int){!(flags & LOOPBACK_OFF)}, sizeof(int)); break;
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
