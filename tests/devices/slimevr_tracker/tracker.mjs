// An emulated tracker of SlimeVR's makers with two sensors: `node tracker.mjs HOST PORT MAC`.
// Input, JSON lines: {"rotation": [x, y, z, w]}, sent 100 times a second from then on; {"battery": [volts, percent]};
// {"action": number}; {"signal": dBm}. Output: the names of its events, one a line, with their values.
import { MACAddress, Quaternion } from '@slimevr/common';
import { FirmwareFeatureFlags, RotationDataType, SensorStatus, SensorType } from '@slimevr/firmware-protocol';
import { EmulatedTracker } from '@slimevr/tracker-emulation';
import { createInterface } from 'node:readline';

const [host, port, mac] = process.argv.slice(2);
const tell = (event, ...values) => console.log(JSON.stringify({ event, values }));
const tracker = new EmulatedTracker(
    new MACAddress(mac.split(':').map((part) => parseInt(part, 16))), 'emulated', new FirmwareFeatureFlags(new Map([['ROTATION_DATA', true]])), undefined, undefined, host, Number(port));
const sensors = [await tracker.addSensor(SensorType.BNO085, SensorStatus.OK), await tracker.addSensor(SensorType.BMI270, SensorStatus.OK)];
for (const event of ['connected-to-server', 'disconnected-from-server'])
    tracker.on(event, (...values) => tell(event, ...values.map(String)));
tracker.on('server-feature-flags', (flags) => tell('server-feature-flags', flags.getAllEnabled()));
tracker.on('incoming-packet', (packet) => tell('packet', packet.type));
tracker.on('unknown-incoming-packet', (data) => tell('unknown', data.toString('hex')));
tracker.on('error', (error) => tell('error', String(error)));
let turned = null;
setInterval(() => turned && sensors.forEach((sensor, number) => sensor.sendRotation(RotationDataType.NORMAL, number ? new Quaternion(0, 0, 1, 0) : turned, 0)), 10);
createInterface({ input: process.stdin }).on('line', async (line) => {
    const { rotation, battery, action, signal } = JSON.parse(line);
    if (rotation) turned = new Quaternion(...rotation);
    if (battery) await tracker.changeBatteryLevel(...battery);
    if (action) await tracker.sendUserAction(action);
    if (signal) await sensors[0].sendSignalStrength(signal);
}).on('close', () => process.exit());
await tracker.init();
