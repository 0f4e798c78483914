"""unitree_sdk2py: so many states of the left hand, and orders meanwhile; domain, topic, count, seconds at most."""

import json
import sys
import time

from unitree_sdk2py.core.channel import ChannelFactoryInitialize, ChannelPublisher, ChannelSubscriber
from unitree_sdk2py.idl.default import unitree_hg_msg_dds__HandCmd_
from unitree_sdk2py.idl.unitree_hg.msg.dds_ import HandCmd_, HandState_

domain, topic, count, seconds = int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), float(sys.argv[4])
ChannelFactoryInitialize(domain, "lo")
states = []
subscriber = ChannelSubscriber(topic, HandState_)
subscriber.Init(states.append, 1000)
publisher = ChannelPublisher("rt/dex3/left/cmd", HandCmd_)
publisher.Init()
order = unitree_hg_msg_dds__HandCmd_()
for k in range(7):
    order.motor_cmd[k].mode = k | 0x10
    order.motor_cmd[k].q = (k if k < 3 else -k) / 10
    order.motor_cmd[k].kp = 1.5
end = time.monotonic() + seconds
while len(states) < count and time.monotonic() < end:
    publisher.Write(order)
    time.sleep(0.01)
states = states[:count]
print(
    json.dumps(
        {
            "pressure": [[each.pressure for each in state.press_sensor_state] for state in states],
            "q": [[each.q for each in state.motor_state] for state in states],
            "modes": [each.mode for each in states[-1].motor_state],
            "temperature": states[-1].press_sensor_state[8].temperature,
            "quaternion": states[-1].imu_state.quaternion,
        }
    ),
    flush=True,
)
