#!/bin/sh
# First process of a user-mode Linux on the host's files: real SocketCAN, an emulator and a host on vcan0.
# Wants FOLDER, PYTHON, REPOSITORY, PACE on the kernel's command line (they arrive as environment).
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t tmpfs tmpfs /run
modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in net/can/can net/can/can-raw net/can/can-bcm drivers/net/can/dev/can-dev drivers/net/can/vcan; do
    insmod "$modules/$module.ko" || echo "cannot load $module"
done
ip link set up lo
ip link add dev vcan0 type vcan && ip link set up vcan0
cd "$REPOSITORY" || halt -f
export PYTHONPATH="$REPOSITORY" PYTHONDONTWRITEBYTECODE=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 HOME=/root
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
bench="$PYTHON -m sysid_bench"
exec </dev/null

# what is wrong with a bus is said at once: no such interface, an interface that is down
$bench measure bus=socketcan bus.channel=can7 out="$FOLDER/none.mcap" 2>"$FOLDER/no_interface.err"
echo $? >"$FOLDER/no_interface.rc"
ip link add dev vcan1 type vcan
$bench measure bus=socketcan bus.channel=vcan1 out="$FOLDER/none.mcap" 2>"$FOLDER/down.err"
echo $? >"$FOLDER/down.rc"

candump -L -r 16777216 vcan0 >"$FOLDER/candump.log" 2>"$FOLDER/candump.err" &
witness=$!
$bench emulate bus=socketcan pace="$PACE" truth="$FOLDER/truth.csv" >"$FOLDER/emulate.out" 2>&1 &
device=$!
while ! grep -q emulating "$FOLDER/emulate.out"; do sleep 0.2; done
$bench measure bus=socketcan pace="$PACE" seconds="$SECONDS_OF_RUN" out="$FOLDER/run.mcap" >"$FOLDER/measure.out" 2>&1
echo $? >"$FOLDER/measure.rc"
# a bus-off, as a controller reports it, ends a run
( sleep "$BUS_OFF_AFTER"; cansend vcan0 20000040#0000000000000000 ) &
$bench measure bus=socketcan pace="$PACE" seconds=60 out="$FOLDER/bus_off.mcap" >"$FOLDER/bus_off.out" 2>&1
echo $? >"$FOLDER/bus_off.rc"
kill $device; wait $device
kill $witness; wait $witness
sync
halt -f
