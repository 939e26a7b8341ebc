// A virtual AGV of the makers of vda-5050-lib: `node agv.mjs PORT VERSION X Y SPEED`, acme 7 on the map "hall".
// Input, JSON lines: a partial state of the AGV to report, such as {"operatingMode": "MANUAL"}.
// Output: "ready", when it is connected.
import { createInterface } from 'node:readline';
import { AgvController, VirtualAgvAdapter } from 'vda-5050-lib';

const [port, vdaVersion, x, y, speed] = process.argv.slice(2);
const agv = new AgvController(
    { manufacturer: 'acme', serialNumber: '7' },
    { interfaceName: 'uagv', vdaVersion, transport: { brokerUrl: `mqtt://127.0.0.1:${port}`, reconnectPeriod: 100 } },
    { agvAdapterType: VirtualAgvAdapter, publishVisualizationInterval: 250 },
    { initialPosition: { mapId: 'hall', x: Number(x), y: Number(y), theta: 0, lastNodeId: 'n0' }, vehicleSpeed: Number(speed), tickRate: 50 });
createInterface({ input: process.stdin })
    .on('line', (line) => agv.updatePartialState(JSON.parse(line), true))
    .on('close', () => process.exit());
await agv.start();
console.log('ready');
