/* The events of udev and of the kernel, for libudev and for programs that read them without it.
 *
 * The kernel delivers them as netlink messages to the members of its group (1) or udev's (2); only root may send there.
 * Here, a socket for them is a datagram socket with a name in the view, in the folder of the group that it has joined;
 * the view's keeper sends the same messages to all sockets of a group. The sender that a program sees is the kernel or
 * udev, with the credentials of root.
 */
#include "preload.h"

#include <errno.h>
#include <linux/netlink.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/un.h>
#include <unistd.h>

#define EVENTS ROOM "/events/"
enum { NO_GROUP, KERNEL, UDEV, GROUPS };
static const char *const folders[GROUPS] = {EVENTS "none/", EVENTS "kernel/", EVENTS "udev/"};
static const char *const senders[GROUPS] = {"", EVENTS "from-kernel", EVENTS "from-udev"};
static const uint32_t udev_sender = 0x7c0ffee; /* its netlink port; the kernel's is 0 */

static bool used; /* whether this process has made such a socket: without one, udev_is costs nothing */

/* Get the name that a socket was made under, in the folder of the group NO_GROUP. */
static bool own_name(int fd, struct sockaddr_un *name) {
    socklen_t length = sizeof *name;
    int before = errno;
    memset(name, 0, sizeof *name);
    bool is = !REAL(getsockname)(fd, (struct sockaddr *)name, &length) && name->sun_family == AF_UNIX &&
              !strncmp(name->sun_path, folders[NO_GROUP], strlen(folders[NO_GROUP]));
    errno = before;
    return is;
}

bool udev_is(int fd) {
    struct sockaddr_un name;
    return used && own_name(fd, &name);
}

int udev_socket(int type) {
    static uint32_t count;
    struct sockaddr_un name = {.sun_family = AF_UNIX};
    int flags = type & (SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (access(ROOM "/events", F_OK)) return REAL(socket)(AF_NETLINK, type, NETLINK_KOBJECT_UEVENT); /* no view */
    int fd = REAL(socket)(AF_UNIX, SOCK_DGRAM | flags, 0);
    if (fd < 0) return fd;
    do { /* a forked child continues the count of its parent, so that names may be taken */
        uint32_t number = __atomic_add_fetch(&count, 1, __ATOMIC_RELAXED);
        snprintf(name.sun_path, sizeof name.sun_path, "%s%d-%u", folders[NO_GROUP], (int)getpid(), number);
    } while (REAL(bind)(fd, (struct sockaddr *)&name, sizeof name) && errno == EADDRINUSE);
    __atomic_store_n(&used, true, __ATOMIC_RELAXED);
    return fd;
}

/* Return the group that a socket is in. */
static int group_of(const struct sockaddr_un *name, char *path, size_t size) {
    const char *last = name->sun_path + strlen(folders[NO_GROUP]);
    for (int group = NO_GROUP; group < GROUPS; group++) {
        snprintf(path, size, "%s%s", folders[group], last);
        if (!access(path, F_OK)) return group;
    }
    return NO_GROUP;
}

static int join(int fd, int group) {
    struct sockaddr_un name;
    char from[128], to[128];
    own_name(fd, &name);
    group_of(&name, from, sizeof from);
    snprintf(to, sizeof to, "%s%s", folders[group], name.sun_path + strlen(folders[NO_GROUP]));
    return rename(from, to);
}

int udev_bind(int fd, const struct sockaddr *address, socklen_t length) {
    const struct sockaddr_nl *asked = (const struct sockaddr_nl *)address;
    if (length < sizeof *asked || asked->nl_family != AF_NETLINK) {
        errno = EINVAL;
        return -1;
    }
    return join(fd, asked->nl_groups & 2 ? UDEV : asked->nl_groups & 1 ? KERNEL : NO_GROUP);
}

static void write_address(struct sockaddr *address, socklen_t *length, uint32_t port, uint32_t groups) {
    struct sockaddr_nl seen = {.nl_family = AF_NETLINK, .nl_pid = port, .nl_groups = groups};
    memcpy(address, &seen, *length < sizeof seen ? *length : sizeof seen);
    *length = sizeof seen;
}

int udev_getsockname(int fd, struct sockaddr *address, socklen_t *length) {
    struct sockaddr_un name;
    char path[128];
    own_name(fd, &name);
    write_address(address, length, (uint32_t)getpid(), (uint32_t)group_of(&name, path, sizeof path));
    return 0;
}

int udev_setsockopt(int fd, int level, int option, const void *value, socklen_t length) {
    if (level != SOL_NETLINK) return REAL(setsockopt)(fd, level, option, value, length);
    if (option == NETLINK_ADD_MEMBERSHIP && length >= sizeof(int)) {
        int group = *(const int *)value;
        return group == KERNEL || group == UDEV ? join(fd, group) : 0;
    }
    return 0;
}

/* Write the credentials of root into a message, as those of the kernel and of udev have. */
static void trust(struct msghdr *message, int group) {
    for (struct cmsghdr *part = CMSG_FIRSTHDR(message); part; part = CMSG_NXTHDR(message, part)) {
        if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_CREDENTIALS) continue;
        struct ucred root = {.pid = group == KERNEL ? 0 : 1};
        memcpy(CMSG_DATA(part), &root, sizeof root);
    }
}

ssize_t udev_recvmsg(int fd, struct msghdr *message, int flags) {
    struct sockaddr_un from = {0};
    struct msghdr inner = *message;
    inner.msg_name = &from;
    inner.msg_namelen = sizeof from;
    ssize_t size = REAL(recvmsg)(fd, &inner, flags);
    if (size < 0) return size;
    int group = NO_GROUP;
    for (int each = KERNEL; each < GROUPS; each++) {
        if (!strcmp(from.sun_path, senders[each])) group = each;
    }
    message->msg_flags = inner.msg_flags;
    message->msg_controllen = inner.msg_controllen;
    if (group == NO_GROUP) return size; /* a sender that libudev would not trust */
    if (message->msg_name) {
        uint32_t port = group == UDEV ? udev_sender : 0;
        write_address(message->msg_name, &message->msg_namelen, port, (uint32_t)group);
    }
    trust(message, group);
    return size;
}
