#!/usr/bin/env bash
# One would guess: a server's handler is run for every call that arrives, and learns by `context.add_callback`,
# or by its False, that the client has gone; so a handler that lasts as long as its client can clean up after it.
# What is so: where the client has left before a thread of the pool is free, the handler is not run at all, and
# nothing is logged. What other calls of that client have set up meanwhile stays. A client that first waits for
# the initial metadata, which the handler sends, is never forgotten so.
# Version: grpcio 1.76.0. Source: https://grpc.github.io/grpc/python/grpc.html (ServicerContext.add_callback: "False
# if the callback was not added and will not later be called (because this RPC already terminated)").
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --no-compile --disable-pip-version-check grpcio==1.76.0
cat > "$folder/calls.py" <<'PY'
import logging
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import grpc

logging.basicConfig(level=logging.WARNING, stream=sys.stdout)
ran = []


def last(request, context):
    alive = context.add_callback(lambda: None)
    ran.append(alive)
    context.send_initial_metadata(())
    while context.is_active():
        time.sleep(0.05)
    yield from ()


class Handlers(grpc.GenericRpcHandler):
    def service(self, details):
        return grpc.unary_stream_rpc_method_handler(last)


pool = ThreadPoolExecutor(1)
server = grpc.server(pool)
port = server.add_insecure_port("127.0.0.1:0")
server.add_generic_rpc_handlers((Handlers(),))
server.start()
channel = grpc.insecure_channel(f"127.0.0.1:{port}", options=[("grpc.enable_http_proxy", 0)])
grpc.channel_ready_future(channel).result(60)
for free_after in (0.0, 5.0):
    ran.clear()
    pool.submit(time.sleep, free_after)
    call = channel.unary_stream("/a/b")(b"")
    time.sleep(2.0)
    call.cancel()
    time.sleep(8.0)
    print(f"a thread is free after {free_after} s, the client leaves after 2 s: the handler ran {len(ran)} times")
server.stop(0)
PY
found=$(timeout 120 "$folder/venv/bin/python" "$folder/calls.py")
echo "$found"
[[ $found == *"after 0.0 s"*"ran 1 times"*"after 5.0 s"*"ran 0 times"* && $found != *WARNING* && $found != *ERROR* ]]
