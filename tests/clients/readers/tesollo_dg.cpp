// Read a Tesollo hand with the vendor's library and write what it decodes for tests.clients.record.
//
//   g++ -std=c++17 -I LIBRARY/include tesollo_dg.cpp LIBRARY/src/delto_developer_TCP.cpp -o reader
//   ./reader PORT MODEL         LIBRARY: a checkout of tesollodelto/dg_tcp_comm

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>

#include "delto_tcp_comm/delto_developer_TCP.hpp"

static std::ofstream rows;

template <class Numbers>
static void write_row(const char* name, const Numbers& numbers) {
  rows << "{\"as\": \"" << name << "\", \"values\": [";
  const char* comma = "";
  for (auto number : numbers) {
    rows << comma << +number;
    comma = ", ";
  }
  rows << "]}\n";
}

template <class Cell>
static void write_cells(const char* name, const std::vector<std::vector<Cell>>& fingers) {
  std::vector<Cell> all;
  for (auto& finger : fingers) all.insert(all.end(), finger.begin(), finger.end());
  if (!all.empty()) write_row(name, all);
}

int main(int argc, char** argv) {
  rows.open(std::getenv("TACTEMU_ROWS"), std::ios::app);
  rows.precision(9);
  DeltoTCP::Communication hand("127.0.0.1", std::stoi(argv[1]), std::stoi(argv[2], nullptr, 16), true, true);
  DeltoTCP::DeltoReceivedData last;
  for (int times : {60, 20}) {
    hand.Connect();
    for (int k = 0; k < times; ++k) {
      last = hand.GetData();
      if (!last.fingertip_sensor.empty()) write_row("wrench", last.fingertip_sensor);
      write_cells("cells", last.tactile_m);
      write_cells("cells", last.tactile_s);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    hand.SetFTSensorOffset();
    hand.SetGPIO(true, false, true);
    std::vector<int> duty(last.joint.size(), 0);
    duty[1] = 500;
    hand.SendDuty(duty);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    last = hand.GetData();
    hand.Disconnect();
  }
  rows << "{\"as\": \"joint 2 [rad], current [mA], outputs 1 2 3, input\", \"value\": [" << last.joint[1] << ", "
       << last.current[1] << ", " << last.gpio[0] << ", " << last.gpio[1] << ", " << last.gpio[2] << ", "
       << last.gpio[3] << "]}\n";
}
