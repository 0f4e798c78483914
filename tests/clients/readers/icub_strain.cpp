// Read an iCub strain board with robotology/icub-main's CanBusAnalogSensor, for tests.clients.record.
//
// icub_yarp.hpp has stand-ins for YARP, and the empty files that the driver includes; a reading waits 3 ms for one more
// frame, for the torques behind the forces.
//
//   g++ -std=c++17 -pthread -I empty -I DRIVER -DDRIVER='"DRIVER/CanBusAnalogSensor.cpp"' icub_strain.cpp -o reader

#include "icub_yarp.hpp"

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
