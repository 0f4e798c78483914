"""websocket-client: so many messages, connecting anew each time that the server closes; URL, count.

Prints for each connection its messages and why it ended: the server's code, "lost" without one, "silent" where a ping
is not answered, "enough". Greetings do not count; 5 connections are the most.
"""

import json
import sys

import websocket

url, left = sys.argv[1], int(sys.argv[2])
runs = []
while left and len(runs) < 5 and not (runs and runs[-1][1] == "silent"):
    client = websocket.create_connection(url, timeout=3)
    messages, why = [], "enough"
    while left:
        try:
            opcode, data = client.recv_data(control_frame=True)
        except websocket.WebSocketTimeoutException:
            why = "silent"
            client.ping()
            try:
                client.recv_data(control_frame=True)
                why = "slow"
            except websocket.WebSocketTimeoutException:
                pass
            break
        except (websocket.WebSocketConnectionClosedException, OSError):
            why = "lost"
            break
        if opcode == websocket.ABNF.OPCODE_CLOSE:
            why = int.from_bytes(data[:2], "big")
            break
        messages.append(json.loads(data))
        left -= messages[-1]["message"] != "Welcome"
    client.shutdown()
    runs.append((messages, why))
print(json.dumps(runs))
