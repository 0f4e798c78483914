// Read inertial sensors of iCub skin boards with robotology/icub-main's CanBusInertialMTB, for tests.clients.record.
//
// icub_yarp.hpp has stand-ins for YARP, and the empty files that the driver includes. SHARED is the folder
// can/canProtocolLib of robotology/icub-firmware-shared.
//
//   g++ -std=c++17 -pthread -I empty -I DRIVER -I SHARED -DDRIVER='"DRIVER/CanBusInertialMTB.cpp"' icub_inertials.cpp
//     -o reader

#include "icub_yarp.hpp"

using yarp::os::Bottle;
using yarp::os::Property;
#include DRIVER

static void write(std::ostream& rows, const char* name, int board, const yarp::sig::Vector& values, size_t start) {
  rows << "{\"as\": \"" << name << " " << board << "\", \"values\": [" << values[start] << ", " << values[start + 1]
       << ", " << values[start + 2] << "]}\n";
}

int main() {
  std::ofstream rows(std::getenv("TACTEMU_ROWS"), std::ios::app);
  next_frame_ms = 0;  // the boards never pause for longer
  for (auto [sensors, times] : {std::pair{"extAccAndGyro", 40}, {"acc", 30}}) {
    CanBusInertialMTB sensor;
    Property config;
    for (auto [key, value] : {std::pair{"canbusDevice", "socketcan"}, {"physDevice", "can0"}, {"canDeviceNum", "0"},
                              {"canAddress", "1 2"}, {"sensorPeriod", "10"}, {"period", "10"},
                              {"sensorType", sensors}})
      config.put(key, std::string(value));
    if (!sensor.open(config)) return 1;
    Time::delay(0.3);
    const size_t channels = sensor.getChannels() / 2;
    for (int k = 0; k < times; ++k, Time::delay(0.02)) {
      yarp::sig::Vector values;
      if (sensor.read(values) != yarp::dev::IAnalogSensor::AS_OK) return 2;
      for (int board : {1, 2}) {
        write(rows, "acceleration", board, values, channels * (board - 1));
        if (channels == 6) write(rows, "rotation", board, values, channels * (board - 1) + 3);
      }
    }
    if (!sensor.close()) return 3;
  }
  rows << "{\"as\": \"complaints\", \"value\": " << complaints << "}\n";
}
