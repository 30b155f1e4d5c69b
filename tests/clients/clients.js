// Headings by libraries of Node: clients.js LIBRARY PORT prints TIME KIND DEGREES of a hundred.
const [name, text] = process.argv.slice(2)
const port = Number(text)
const hostname = '127.0.0.1'
let left = 100

function print(line) {
  console.log(line)
  left -= 1
  if (left === 0) process.exit()
}

function watch(listener) {
  listener.on('ATT', (att) => print(`${att.time} true ${att.heading} magnetic ${att.mheading}`))
  listener.connect(() => listener.watch())
}

if (name === 'node-gpsd') {
  const { Listener } = require('node-gpsd')
  watch(new Listener({ port, hostname }))
} else if (name === 'node-gpsd-client') {
  const Gpsd = require('node-gpsd-client')
  watch(new Gpsd({ port, hostname }))
} else {
  // Signal K's provider hands what it receives to Signal K's parser, as its server does.
  const Provider = require('@signalk/streams/gpsd').default
  const Parser = require('@signalk/nmea0183-signalk')
  const parser = new Parser()
  const silent = () => {}
  const app = { setProviderStatus: silent, setProviderError: (id, message) => console.error(message) }
  const kinds = { 'navigation.headingMagnetic': 'magnetic', 'navigation.headingTrue': 'true' }
  new Provider({ port, hostname, app, providerId: 'headingd' }).on('data', (line) => {
    const delta = line.startsWith('$') ? parser.parse(line.trim()) : null
    for (const update of delta ? delta.updates : []) {
      for (const { path, value } of update.values) {
        if (kinds[path]) print(`- ${kinds[path]} ${(value * 180) / Math.PI}`)
      }
    }
  })
}
