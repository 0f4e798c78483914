/* The functions of libc that are replaced. Calls that concern no subject go on to libc. */
#include "preload.h"

#include <linux/netlink.h>
#include <linux/sockios.h>
#include <stdarg.h>
#include <sys/ioctl.h>
#include <sys/uio.h>
#include <unistd.h>

int ioctl(int fd, unsigned long request, ...) {
    va_list arguments;
    va_start(arguments, request);
    void *argument = va_arg(arguments, void *);
    va_end(arguments);
    if (request >> 8 == SIOCGIFNAME >> 8 && can_state(fd)) return can_ioctl(fd, request, argument);
    return tty_ioctl(fd, request, argument);
}

int tcsetattr(int fd, int actions, const struct termios *settings) {
    return tty_setattr(fd, actions, settings);
}

int tcgetattr(int fd, struct termios *settings) {
    return tty_getattr(fd, settings);
}

int tcsendbreak(int fd, int duration) {
    return tty_sendbreak(fd, duration);
}

int socket(int domain, int type, int protocol) {
    if (domain == AF_NETLINK && protocol == NETLINK_KOBJECT_UEVENT) return udev_socket(type);
    if (domain == PF_CAN) return can_socket(type, protocol);
    return REAL(socket)(domain, type, protocol);
}

int bind(int fd, const struct sockaddr *address, socklen_t length) {
    if (udev_is(fd)) return udev_bind(fd, address, length);
    if (can_state(fd)) return can_bind(fd, address, length);
    return REAL(bind)(fd, address, length);
}

int getsockname(int fd, struct sockaddr *address, socklen_t *length) {
    if (udev_is(fd)) return udev_getsockname(fd, address, length);
    if (can_state(fd)) return can_getsockname(fd, address, length);
    return REAL(getsockname)(fd, address, length);
}

int setsockopt(int fd, int level, int option, const void *value, socklen_t length) {
    if (udev_is(fd)) return udev_setsockopt(fd, level, option, value, length);
    if (can_state(fd)) return can_setsockopt(fd, level, option, value, length);
    return REAL(setsockopt)(fd, level, option, value, length);
}

ssize_t recvmsg(int fd, struct msghdr *message, int flags) {
    if (udev_is(fd)) return udev_recvmsg(fd, message, flags);
    if (can_state(fd)) return can_recvmsg(fd, message, flags);
    return REAL(recvmsg)(fd, message, flags);
}

int getsockopt(int fd, int level, int option, void *value, socklen_t *length) {
    if (can_state(fd)) return can_getsockopt(fd, level, option, value, length);
    return REAL(getsockopt)(fd, level, option, value, length);
}

int recvmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags, struct timespec *timeout) {
    if (can_state(fd)) return can_recvmmsg(fd, messages, count, flags, timeout);
    return REAL(recvmmsg)(fd, messages, count, flags, timeout);
}

ssize_t recvfrom(int fd, void *data, size_t size, int flags, struct sockaddr *address, socklen_t *length) {
    if (can_state(fd)) return can_recvfrom(fd, data, size, flags, address, length);
    return REAL(recvfrom)(fd, data, size, flags, address, length);
}

ssize_t recv(int fd, void *data, size_t size, int flags) {
    ssize_t got = REAL(recv)(fd, data, size, flags);
    return got < 0 ? can_failed(fd) : got;
}

ssize_t read(int fd, void *data, size_t size) {
    ssize_t got = REAL(read)(fd, data, size);
    return got < 0 ? can_failed(fd) : got;
}

ssize_t readv(int fd, const struct iovec *parts, int count) {
    ssize_t got = REAL(readv)(fd, parts, count);
    return got < 0 ? can_failed(fd) : got;
}

ssize_t write(int fd, const void *data, size_t size) {
    int state = can_state(fd);
    return state ? can_send(fd, state, data, size, 0) : REAL(write)(fd, data, size);
}

ssize_t writev(int fd, const struct iovec *parts, int count) {
    int state = can_state(fd);
    if (!state) return REAL(writev)(fd, parts, count);
    struct msghdr message = {.msg_iov = (struct iovec *)parts, .msg_iovlen = (size_t)count};
    return can_sendmsg(fd, state, &message, 0);
}

ssize_t send(int fd, const void *data, size_t size, int flags) {
    int state = can_state(fd);
    return state ? can_send(fd, state, data, size, flags) : REAL(send)(fd, data, size, flags);
}

ssize_t sendto(int fd, const void *data, size_t size, int flags, const struct sockaddr *to, socklen_t length) {
    int state = can_state(fd);
    if (!state) return REAL(sendto)(fd, data, size, flags, to, length);
    struct iovec part = {(void *)data, size};
    struct msghdr message = {.msg_name = (void *)to, .msg_namelen = length, .msg_iov = &part, .msg_iovlen = 1};
    return can_sendmsg(fd, state, &message, flags);
}

ssize_t sendmsg(int fd, const struct msghdr *message, int flags) {
    int state = can_state(fd);
    return state ? can_sendmsg(fd, state, message, flags) : REAL(sendmsg)(fd, message, flags);
}

int sendmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags) {
    int state = can_state(fd);
    return state ? can_sendmmsg(fd, state, messages, count, flags) : REAL(sendmmsg)(fd, messages, count, flags);
}

/* Programs compiled with checks of their buffers call these instead. */
ssize_t __read_chk(int fd, void *data, size_t size, size_t room) {
    return size > room ? REAL(__read_chk)(fd, data, size, room) : read(fd, data, size);
}

ssize_t __recv_chk(int fd, void *data, size_t size, size_t room, int flags) {
    return size > room ? REAL(__recv_chk)(fd, data, size, room, flags) : recv(fd, data, size, flags);
}

ssize_t __recvfrom_chk(int fd, void *data, size_t size, size_t room, int flags, struct sockaddr *from, socklen_t *length) {
    if (size > room) return REAL(__recvfrom_chk)(fd, data, size, room, flags, from, length);
    return recvfrom(fd, data, size, flags, from, length);
}
