// Reads CAN frames as drivers in C++ do: `can_reader can0 COUNT ID MASK`. A line for each: seconds, identifier, data.
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>

int main(int, char **arguments) {
    int bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    ifreq wanted{};
    std::strncpy(wanted.ifr_name, arguments[1], IFNAMSIZ - 1);
    if (bus < 0 || ioctl(bus, SIOCGIFINDEX, &wanted) < 0) return std::perror("no bus"), 1;
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = wanted.ifr_ifindex;
    can_filter only{static_cast<canid_t>(std::strtoul(arguments[3], nullptr, 16)),
                    static_cast<canid_t>(std::strtoul(arguments[4], nullptr, 16))};
    int on = 1;
    setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FILTER, &only, sizeof only);
    setsockopt(bus, SOL_SOCKET, SO_TIMESTAMP, &on, sizeof on);
    if (bind(bus, reinterpret_cast<sockaddr *>(&address), sizeof address) < 0) return std::perror("bind"), 1;
    std::puts("listening");
    std::fflush(stdout);
    for (int count = std::atoi(arguments[2]); count > 0; count--) {
        pollfd wait{bus, POLLIN, 0};
        if (poll(&wait, 1, 5000) != 1) return std::fputs("nothing came\n", stderr), 2;
        can_frame frame{};
        char beside[64];
        iovec part{&frame, sizeof frame};
        msghdr message{};
        message.msg_iov = &part;
        message.msg_iovlen = 1;
        message.msg_control = beside;
        message.msg_controllen = sizeof beside;
        if (recvmsg(bus, &message, 0) != sizeof frame) return std::perror("recvmsg"), 3;
        timeval at{};
        std::memcpy(&at, CMSG_DATA(CMSG_FIRSTHDR(&message)), sizeof at);
        std::printf("%ld.%06ld %03X ", at.tv_sec, at.tv_usec, frame.can_id);
        for (int k = 0; k < frame.can_dlc; k++) std::printf("%02X", frame.data[k]);
        std::puts(message.msg_flags & MSG_DONTROUTE ? " host" : " bus");
    }
    return 0;
}
