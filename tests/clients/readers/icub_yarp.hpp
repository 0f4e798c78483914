// Small stand-ins for what drivers of robotology/icub-main use of YARP: configuration, log, thread, and a CAN device over
// SocketCAN's can0. The drivers' #includes of YARP need files of these names, which may be empty:
//
//   mkdir -p empty/yarp/os empty/yarp/dev empty/yarp/sig
//   touch empty/yarp/os/{Time,LogStream,Log,PeriodicThread}.h empty/yarp/sig/Vector.h
//   touch empty/yarp/dev/{IAnalogSensor,PolyDriver,CanBusInterface}.h

#pragma once

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <limits>
#include <map>
#include <mutex>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace yarp::os {
struct Value {
  std::string text;
  bool isInt32() const { return !text.empty() && text.find_first_not_of("0123456789") == std::string::npos; }
  bool isString() const { return !text.empty(); }
  int asInt32() const { return text.empty() ? 0 : std::stoi(text); }
  std::string asString() const { return text; }
  std::string toString() const { return text; }
};
struct Bottle {
  std::vector<Value> values;
  bool isNull() const { return values.empty(); }
  int size() const { return static_cast<int>(values.size()); }
  Value get(int k) const { return values[k]; }
  Bottle tail() const { return *this; }
  std::string toString() const {
    std::string all;
    for (const Value& value : values) all += value.text + " ";
    return all;
  }
};
struct Searchable {
  std::map<std::string, std::string> values;
  bool check(const std::string& key) const { return values.count(key) > 0; }
  Value find(const std::string& key) const { return check(key) ? Value{values.at(key)} : Value{}; }
  Bottle findGroup(const std::string& key) const {
    Bottle found;
    std::istringstream words(find(key).text);
    for (std::string word; words >> word;) found.values.push_back({word});
    return found;
  }
  std::string toString() const { return "configuration"; }
};
struct Property : Searchable {
  void put(const std::string& key, const std::string& value) { values[key] = value; }
  void put(const std::string& key, int value) { values[key] = std::to_string(value); }
};
struct Time {
  static void delay(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }
  static double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }
};
class PeriodicThread {
  std::atomic<bool> running{false};
  std::atomic<double> period;
  std::thread thread;

 public:
  explicit PeriodicThread(double seconds) : period(seconds) {}
  virtual ~PeriodicThread() = default;
  void setPeriod(double seconds) { period = seconds; }
  bool start() {
    if (!threadInit()) return false;
    running = true;
    thread = std::thread([this] {
      for (; running; Time::delay(period)) run();
      threadRelease();
    });
    return true;
  }
  void stop() {
    running = false;
    if (thread.joinable()) thread.join();
  }
  virtual bool threadInit() { return true; }
  virtual void threadRelease() {}
  virtual void run() = 0;
};
}  // namespace yarp::os

namespace yarp::sig {
struct Vector : std::vector<double> {
  void zero() { assign(size(), 0.0); }
};
}  // namespace yarp::sig

static int complaints = 0;
struct Log {
  bool ends = false;
  ~Log() { if (ends) std::cerr << "\n"; }
  template <class T>
  Log& operator<<(const T& value) {
    std::cerr << value;
    ends = true;
    return *this;
  }
};
static Log say(const char* kind) { std::cerr << kind << " "; return {}; }
static void say(const char* kind, const char* format, ...) {
  std::va_list values;
  va_start(values, format);
  std::fprintf(stderr, "%s ", kind);
  std::vfprintf(stderr, format, values);
  std::fprintf(stderr, "\n");
  va_end(values);
}
template <class... T> static auto yError(T... all) { ++complaints; return say("ERROR", all...); }
template <class... T> static auto yWarning(T... all) { ++complaints; return say("WARNING", all...); }
template <class... T> static auto yInfo(T... all) { return say("INFO", all...); }
template <class... T> static auto yDebug(T... all) { return say("DEBUG", all...); }
template <class... T> static auto yTrace(T... all) { return say("TRACE", all...); }

namespace yarp::dev {
struct DeviceDriver {
  virtual ~DeviceDriver() = default;
  virtual bool open(os::Searchable&) { return true; }
  virtual bool close() { return true; }
};
struct IAnalogSensor {
  enum { AS_OK = 0, AS_ERROR = 1, AS_OVF = 2, AS_TIMEOUT = 3 };
  virtual ~IAnalogSensor() = default;
  virtual int read(sig::Vector&) = 0;
  virtual int getState(int) = 0;
  virtual int getChannels() = 0;
  virtual int calibrateSensor() = 0;
  virtual int calibrateSensor(const sig::Vector&) = 0;
  virtual int calibrateChannel(int) = 0;
  virtual int calibrateChannel(int, double) = 0;
};
struct CanMessage {
  unsigned id = 0, length = 0;
  unsigned char data[8] = {};
  unsigned getId() const { return id; }
  void setId(unsigned value) { id = value; }
  unsigned getLen() const { return length; }
  void setLen(unsigned value) { length = value; }
  unsigned char* getData() { return data; }
};
struct CanBuffer {
  std::vector<CanMessage>* messages = nullptr;
  CanMessage& operator[](int k) { return (*messages)[k]; }
};
struct ICanBufferFactory {
  CanBuffer createBuffer(int n) { return {new std::vector<CanMessage>(n)}; }
  void destroyBuffer(CanBuffer& buffer) { delete buffer.messages; }
};
static int next_frame_ms = 3;
/// The time for which a reading waits for one more frame.
class ICanBus {
  int fd = -1;
  std::set<unsigned> wanted;

 public:
  bool begin() {
    fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    ifreq request{};
    std::strcpy(request.ifr_name, "can0");
    if (fd < 0 || ioctl(fd, SIOCGIFINDEX, &request) < 0) return false;
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = request.ifr_ifindex;
    return bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  void end() { ::close(fd); }
  bool canSetBaudRate(unsigned) { return true; }
  bool canIdAdd(unsigned id) { return wanted.insert(id).second; }
  bool canRead(CanBuffer& buffer, unsigned size, unsigned* n, bool = false) {
    pollfd ready{fd, POLLIN, 0};
    for (*n = 0; *n < size && poll(&ready, 1, *n ? next_frame_ms : 0) > 0;) {
      can_frame frame{};
      if (::read(fd, &frame, sizeof frame) != static_cast<ssize_t>(sizeof frame)) return false;
      if (!wanted.count(frame.can_id)) continue;
      CanMessage& message = buffer[(*n)++];
      message.id = frame.can_id;
      message.length = frame.can_dlc;
      std::memcpy(message.data, frame.data, 8);
    }
    return true;
  }
  bool canWrite(CanBuffer& buffer, unsigned size, unsigned* n) {
    for (*n = 0; *n < size; ++*n) {
      can_frame frame{};
      frame.can_id = buffer[*n].id;
      frame.can_dlc = buffer[*n].length;
      std::memcpy(frame.data, buffer[*n].data, frame.can_dlc);
      if (::write(fd, &frame, sizeof frame) != static_cast<ssize_t>(sizeof frame)) return false;
    }
    return true;
  }
};
class PolyDriver {
  ICanBus bus;
  ICanBufferFactory factory;
  bool valid = false;

 public:
  bool open(os::Searchable&) { return valid = bus.begin(); }
  bool isValid() const { return valid; }
  void view(ICanBus*& found) { found = &bus; }
  void view(ICanBufferFactory*& found) { found = &factory; }
  void close() { bus.end(); }
};
}  // namespace yarp::dev
