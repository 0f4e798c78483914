// Read an ATI Wireless F/T with the class of personalrobotics/forque_sensor_hardware and write what it decodes for
// tests.clients.record.
//
//   g++ -std=c++17 -include stdexcept -include chrono -I CHECKOUT/include ati_wireless_ft.cpp
//       CHECKOUT/src/wireless_ft.cpp -o reader
//   ./reader UDP_PORT TELNET_PORT

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include "forque_sensor_hardware/wireless_ft.h"

int main(int argc, char** argv) {
  std::ofstream rows(std::getenv("TACTEMU_ROWS"), std::ios::app);
  for (int times : {60, 30}) {
    forque_sensor_hardware::WirelessFT sensor;
    if (!sensor.udpConfigure("127.0.0.1", std::stoi(argv[1]), -1) || !sensor.udpResetTelnet()) return 1;
    if (!sensor.udpStartStreaming() || !sensor.telnetConnect("127.0.0.1", std::stoi(argv[2]))) return 2;
    if (!sensor.setBias(false) || !sensor.setRate(50, 2) || !sensor.enableNTP(false) || !sensor.enableNTP()) return 3;
    for (int turn : {0, 1}) {
      for (int k = 0; k < times; ++k) {
        auto packet = sensor.readDataPacket();
        if (!packet.valid) continue;
        rows << "{\"as\": \"counts\", \"values\": [";
        const char* comma = "";
        for (int i = 0; i < NUMBER_OF_TRANSDUCERS; ++i)
          for (int j = 0; packet.transducer_present[i] && j < NUMBER_OF_STRAIN_GAGES; ++j, comma = ", ")
            rows << comma << packet.counts[i][j];
        rows << "]}\n";
      }
      if (turn == 0 && !sensor.setBias(true)) return 4;
    }
    if (!sensor.setBias(false, 1)) return 5;
  }
}
