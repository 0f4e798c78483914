// A driver in C++: `serial_reader NODE COUNT` reads frames of AnySkin (80 bytes, CR LF) and prints them in hexadecimal
// digits, a frame a line.
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <string>
#include <termios.h>
#include <unistd.h>

int main(int, char **arguments) {
  const int node = open(arguments[1], O_RDWR | O_NOCTTY);
  if (node < 0) return perror(arguments[1]), 1;
  termios setting{};
  tcgetattr(node, &setting);
  cfmakeraw(&setting);
  cfsetspeed(&setting, B115200);
  setting.c_cc[VMIN] = 1;
  setting.c_cc[VTIME] = 0;
  tcsetattr(node, TCSANOW, &setting);
  tcflush(node, TCIOFLUSH);
  std::string data;
  for (int count = std::atoi(arguments[2]); count > 0;) {
    char chunk[256];
    const ssize_t size = read(node, chunk, sizeof chunk);
    if (size <= 0) return perror("read"), 1;
    data.append(chunk, size);
    // A frame ends with CR LF at its 81st byte; until one does, the place is searched for.
    while (count > 0 && data.size() >= 82) {
      if (data[80] != '\r' || data[81] != '\n') {
        data.erase(0, 1);
        continue;
      }
      for (size_t at = 0; at < 80; at++)
        std::printf("%02x", static_cast<unsigned char>(data[at]));
      std::printf("\n");
      data.erase(0, 82);
      count--;
    }
  }
  return close(node);
}
