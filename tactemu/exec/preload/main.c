/* The functions of libc that are taken over. What is no subject's goes on to libc. */
#include "preload.h"

#include <linux/netlink.h>
#include <stdarg.h>
#include <sys/ioctl.h>

int ioctl(int fd, unsigned long request, ...) {
    va_list rest;
    va_start(rest, request);
    void *argument = va_arg(rest, void *);
    va_end(rest);
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
    return REAL(socket)(domain, type, protocol);
}

int bind(int fd, const struct sockaddr *address, socklen_t length) {
    if (udev_is(fd)) return udev_bind(fd, address, length);
    return REAL(bind)(fd, address, length);
}

int getsockname(int fd, struct sockaddr *address, socklen_t *length) {
    if (udev_is(fd)) return udev_getsockname(fd, address, length);
    return REAL(getsockname)(fd, address, length);
}

int setsockopt(int fd, int level, int option, const void *value, socklen_t length) {
    if (udev_is(fd)) return udev_setsockopt(fd, level, option, value, length);
    return REAL(setsockopt)(fd, level, option, value, length);
}

ssize_t recvmsg(int fd, struct msghdr *message, int flags) {
    if (udev_is(fd)) return udev_recvmsg(fd, message, flags);
    return REAL(recvmsg)(fd, message, flags);
}
