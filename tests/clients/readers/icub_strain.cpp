// Read an iCub strain board with robotology/icub-main's CanBusAnalogSensor, for tests.clients.record.
//
// Here stand small stand-ins for what it uses of YARP: configuration, log, thread, and a CAN device over SocketCAN's
// can0. The driver's #includes of YARP need files of these names, which may be empty:
//
//   mkdir -p empty/yarp/os empty/yarp/dev empty/yarp/sig
//   touch empty/yarp/os/{Time,LogStream,Log,PeriodicThread}.h empty/yarp/sig/Vector.h
//   touch empty/yarp/dev/{IAnalogSensor,PolyDriver,CanBusInterface}.h
//   g++ -std=c++17 -pthread -I empty -I DRIVER -DDRIVER='"DRIVER/CanBusAnalogSensor.cpp"' icub_strain.cpp -o reader

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
#include <string>
#include <thread>
#include <vector>

namespace yarp::os {
struct Value {
  std::string text;
  int asInt32() const { return text.empty() ? 0 : std::stoi(text); }
  std::string asString() const { return text; }
  std::string toString() const { return text; }
};
struct Searchable {
  std::map<std::string, std::string> values;
  bool check(const std::string& key) const { return values.count(key) > 0; }
  Value find(const std::string& key) const { return check(key) ? Value{values.at(key)} : Value{}; }
  std::string toString() const { return "strain"; }
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
    for (*n = 0; *n < size && poll(&ready, 1, *n ? 3 : 0) > 0;) {  // waits for the torques behind the forces
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

using yarp::os::Time;
#include DRIVER

int main() {
  std::ofstream rows(std::getenv("TACTEMU_ROWS"), std::ios::app);
  rows.precision(17);
  for (auto [calibration, times] : {std::pair{"1", 60}, {"0", 30}, {"1", 30}}) {
    CanBusAnalogSensor sensor;
    Property config;
    for (auto [key, value] : {std::pair{"canbusDevice", "socketcan"}, {"physDevice", "can0"}, {"canDeviceNum", "0"},
                              {"canAddress", "1"}, {"format", "16"}, {"period", "10"}, {"channels", "6"},
                              {"useCalibration", calibration}, {"diagnostic", "1"}, {"deviceId", "strain"}})
      config.put(key, std::string(value));
    if (!sensor.open(config)) return 1;
    Time::delay(0.3);
    for (int k = 0; k < times; ++k, Time::delay(0.02)) {
      yarp::sig::Vector values;
      if (sensor.read(values) != yarp::dev::IAnalogSensor::AS_OK) return 2;
      rows << "{\"as\": \"" << (calibration[0] == '1' ? "wrench" : "gauges") << "\", \"values\": [";
      for (size_t i = 0; i < values.size(); ++i) rows << (i ? ", " : "") << values[i];
      rows << "]}\n";
    }
    if (!sensor.close()) return 3;
  }
  rows << "{\"as\": \"complaints\", \"value\": " << complaints << "}\n";
}
