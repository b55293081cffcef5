// NOT RUN: nobody has run this file yet.
//
// A run's tasks by Nextflow, from 24.04 on: equal workers, each of which does whatever can be done until nothing is left.
//
//     nextflow run nextflow.nf --inputs 'tiles/*.laz' --output /shared/city.ply --work /shared/city --workers 16 --options '--cell-size auto'
//
// All paths are reached by all machines, by the same names. docs/clusters.md tells more.

params.inputs = null
params.output = null
params.work = null
params.workers = 8
params.options = ''
params.program = 'asra-stream'

// Exit codes of what may pass.
again = [69, 74, 75, 76, 129, 137, 143]

process plan {
    cpus 2
    memory '8 GB'
    errorStrategy { task.exitStatus in again ? 'retry' : 'terminate' }
    maxRetries 3

    output:
    val true

    // Paths are those of the folder where Nextflow was started.
    script:
    """
    cd '${launchDir}'
    '${params.program}' plan ${params.inputs} --output '${params.output}' --work '${params.work}' --processes ${params.workers} ${params.options} > /dev/null
    """
}

process work {
    cpus 8
    memory '16 GB'
    time '4h'
    // What is done stays done, and a worker that comes back finds what is left.
    errorStrategy { task.exitStatus in again ? 'retry' : 'terminate' }
    maxRetries 20

    input:
    val shard
    val planned

    script:
    """
    cd '${launchDir}'
    '${params.program}' work '${params.work}' --any --shard ${shard}/${params.workers} --for 200m --threads ${task.cpus} --max-memory ${task.memory.toMega() * 3 / 4 as long}M
    """
}

workflow {
    work(Channel.of(0..<params.workers), plan())
}
