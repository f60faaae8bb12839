import aQute.lib.getopt.CommandLine;
import java.io.BufferedReader;
import java.io.InputStreamReader;
import java.io.PrintStream;
import java.lang.reflect.Field;
import java.nio.charset.StandardCharsets;
import java.nio.file.Path;
import java.util.ArrayList;
import java.util.List;
import java.util.concurrent.LinkedBlockingQueue;
import org.alloytools.alloy.core.infra.AlloyDispatcher;

/**
 * Does as the Analyzer's own command line does, with its arguments, once for each line of standard input.
 *
 * A line is four words: two that are given back, a directory and the name of the main file there. What the Analyzer
 * writes to standard error and output goes to the files "diagnostics" and "messages" of that directory, instances to
 * "solutions". Then a line on standard output gives back the two words and the exit status. The end of standard input
 * ends this program, whatever is being done.
 */
public final class Resident {

    public static void main(String[] arguments) throws Exception {
        PrintStream answers = System.out;
        LinkedBlockingQueue<String> asked = new LinkedBlockingQueue<>();
        Thread reader = new Thread(() -> read(asked));
        reader.setDaemon(true);
        reader.start();
        while (true) {
            String[] words = asked.take().split(" ");
            int status = answer(List.of(arguments), Path.of(words[2]).toAbsolutePath(), words[3]);
            answers.println(words[0] + " " + words[1] + " " + status);
        }
    }

    private static int answer(List<String> arguments, Path directory, String main) throws Exception {
        List<String> command = new ArrayList<>(arguments);
        command.add(directory.resolve("solutions").toString());
        command.add(directory.resolve(main).toString());
        try (PrintStream diagnostics = new PrintStream(directory.resolve("diagnostics").toString());
                PrintStream messages = new PrintStream(directory.resolve("messages").toString())) {
            System.setErr(diagnostics);
            System.setOut(messages);
            keepLogOn(diagnostics);
            AlloyDispatcher.exitCode = 0;
            try {
                AlloyDispatcher analyzer = new AlloyDispatcher();
                String fault = new CommandLine(analyzer).execute(analyzer, "_alloy", command);
                if (fault != null)
                    System.err.println(fault);
            } catch (Throwable thrown) {
                thrown.printStackTrace();
                return 1;
            }
            return AlloyDispatcher.exitCode;
        }
    }

    /** The Analyzer's log has kept the stream that was standard error when it was loaded. */
    private static void keepLogOn(PrintStream stream) throws ReflectiveOperationException {
        Field target = Class.forName("org.slf4j.impl.SimpleLogger").getDeclaredField("TARGET_STREAM");
        target.setAccessible(true);
        target.set(null, stream);
    }

    private static void read(LinkedBlockingQueue<String> asked) {
        try (BufferedReader lines = new BufferedReader(new InputStreamReader(System.in, StandardCharsets.US_ASCII))) {
            for (String line = lines.readLine(); line != null; line = lines.readLine())
                asked.add(line);
        } catch (Exception exception) {
            exception.printStackTrace();
        } finally {
            Runtime.getRuntime().halt(1);
        }
    }
}
